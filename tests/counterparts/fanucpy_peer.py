"""fanucpy against a MAPPDK server, in an environment of its own.

Called as `.counterparts/fanucpy/bin/python fanucpy_peer.py PORT`: moves the robot to ten poses and prints what it reads
after each, as one JSON line of joints and pose.
"""

from __future__ import annotations

import json
import sys

from fanucpy import Robot  # pyright: ignore[reportMissingImports]


def main(port: int) -> None:
    robot = Robot("Fanuc", "127.0.0.1", port, socket_timeout=10)
    robot.connect()
    for i in range(10):
        robot.move("joint", [10.0 * i, 20.0, -30.5, 40.0, -45.125, 3.0 * i], velocity=100, cnt_val=0)
        sys.stdout.write(json.dumps([robot.get_curjpos(), robot.get_curpos()]) + "\n")
    robot.disconnect()


if __name__ == "__main__":
    main(int(sys.argv[1]))
