"""Numerical solver of roboticstoolbox on the poses of a case, one after the other.

It runs in a separate environment:

    python inverse_toolbox.py ANSWER.json CASE.json
"""
# pyright: reportMissingImports=false

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
from roboticstoolbox import DHRobot, RevoluteDH, RevoluteMDH

TRIES = 3


def main(answer: str, case: str) -> None:
    """Write the time per pose and the share of poses that were reached.

    The time is the least processor time of some tries, s.
    """
    table = json.loads(Path(case).read_text(encoding="utf-8"))
    link = RevoluteMDH if table["convention"] == "mdh" else RevoluteDH
    rows = zip(table["alpha"], table["a"], table["theta"], table["d"], strict=True)
    chain = DHRobot([link(alpha=alpha, a=a, offset=theta, d=d) for alpha, a, theta, d in rows]).ets()
    poses = [np.array(pose) for pose in table["poses"]]
    least, reached = float("inf"), 0
    for _ in range(TRIES):
        begin = time.process_time()
        found = [chain.ik_LM(pose) for pose in poses]
        least = min(least, time.process_time() - begin)
        reached = sum(bool(each[1]) for each in found)
    out = {"seconds_each": least / len(poses), "reached": reached / len(poses)}
    Path(answer).write_text(json.dumps(out), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
