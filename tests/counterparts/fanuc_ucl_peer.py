"""fanuc-ucl against an RMI server at 127.0.0.1:16001, in a separate environment.

Called as `.counterparts/fanuc-ucl/bin/python fanuc_ucl_peer.py`: starts remote motion, sends four motions in a row,
reads the joints, sends an abort that is refused, and prints all as one JSON line.
"""

from __future__ import annotations

import json
import sys

from fanuc_ucl import JointFormat, JointTemplate, rmi  # pyright: ignore[reportMissingImports]

SIX = JointFormat.FanucDeg, JointTemplate.SIX


def main() -> None:
    driver = rmi.RmiDriver(rmi.RmiDriverConfig("127.0.0.1", timeout_secs=20.0))
    driver.connect()
    driver.send(rmi.FrcReset()).wait_timeout(20.0)
    driver.send(rmi.FrcInitialize()).wait_timeout(20.0)
    before = driver.send(rmi.FrcGetStatus()).wait_timeout(20.0)
    moves = [
        driver.send(
            rmi.FrcJointMotionJRep(
                rmi.JointAngles(*SIX, 10.0 * i, 20.0, -30.5, 40.0, -45.125, 3.0 * i),
                rmi.SpeedType.MilliSeconds,
                500,
                rmi.TermType.FINE if i == 3 else rmi.TermType.CNT,
                100,
            )
        )
        for i in range(4)
    ]
    numbers = [move.wait_timeout(20.0).sequence_id for move in moves]
    joints = driver.send(rmi.FrcReadJointAngles()).wait_timeout(20.0).joints(*SIX).as_array()
    driver.send(rmi.FrcAbort()).wait_timeout(20.0)
    try:
        driver.send(rmi.FrcAbort()).wait_timeout(20.0)
        refused = ""
    except RuntimeError as error:
        refused = str(error)
    driver.disconnect()
    states = [before.servo_ready, before.tp_mode, before.rmi_motion_status]
    sys.stdout.write(
        json.dumps({"numbers": numbers, "joints": joints, "states": states, "refused": refused}) + "\n"
    )


if __name__ == "__main__":
    main()
