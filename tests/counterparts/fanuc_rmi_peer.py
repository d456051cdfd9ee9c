"""fanuc-rmi against an RMI server, in a separate environment.

Called as `.counterparts/fanuc-rmi/bin/python fanuc_rmi_peer.py PORT SESSION_PORT`: moves the robot to five poses and
prints the joints that it reads after each, as JSON lines. It looks for the port of the session under another name than
the manual's, so that it needs it.
"""

from __future__ import annotations

import json
import os
import sys

from fanuc_rmi import RobotClient  # pyright: ignore[reportMissingImports]


def main(port: int, session: int) -> None:
    out, sys.stdout = sys.stdout, sys.stderr  # it prints what it does
    robot = RobotClient("127.0.0.1", port, session, startup_pause=0.0)
    robot.connect()
    robot.initialize(uframe=0, utool=1)
    robot.speed_override(50)
    for i in range(5):
        joints = {f"J{k}": q for k, q in enumerate((10.0 * i, 20.0, -30.5, 40.0, -45.125, 3.0 * i), start=1)}
        robot.joint_absolute(joints, speed_percentage=100, sequence_id=i + 1)
        read = robot.read_joint_coordinates(os.devnull)
        out.write(json.dumps([read["JointAngle"][f"J{k}"] for k in range(1, 7)]) + "\n")
    robot.abort()
    robot.close()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
