"""ur-rtde (SDU Robotics, C++) against an RTDE server, in an environment and a process of its own.

Called as `.counterparts/ur-rtde/bin/python ur_rtde_peer.py`: for every line on standard input it prints what it reads
from 127.0.0.1:30004, as one JSON line of joints (rad), joint targets (rad), robot mode and safety mode.
"""

from __future__ import annotations

import json
import sys
import time

from rtde_receive import RTDEReceiveInterface  # pyright: ignore[reportMissingImports]


def main() -> None:
    robot = RTDEReceiveInterface("127.0.0.1")
    for _ in sys.stdin:
        time.sleep(0.05)  # it shows the last package received, and has no call that waits for the next
        modes = [robot.getRobotMode(), robot.getSafetyMode()]
        sys.stdout.write(json.dumps([robot.getActualQ(), robot.getTargetQ(), *modes]) + "\n")
        sys.stdout.flush()
    robot.disconnect()


if __name__ == "__main__":
    main()
