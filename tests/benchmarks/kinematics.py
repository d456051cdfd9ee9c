"""Benchmark of the kinematics of 10,000 configurations at once: 100 times as fast or more.

The reference is the same function called one by one.
"""

from __future__ import annotations

import numpy as np

from calib import forward, load_robot
from tests.benchmarks.clock import line, seconds

CONFIGURATIONS = 10_000
WANTED = 100.0


def run() -> bool:
    """Print the ratio for one robot of each convention."""
    reached = True
    for name in ("abb-irb120", "ur10"):
        robot = load_robot(name)
        joints = np.random.default_rng(1).uniform(-2.0, 2.0, (CONFIGURATIONS, robot.joints))

        def one_by_one() -> None:
            for i in range(CONFIGURATIONS):
                forward(robot, joints[i : i + 1])  # noqa: B023 - called before the loop goes on

        forward(robot, joints)
        together = seconds(lambda: forward(robot, joints))  # noqa: B023
        loop = seconds(one_by_one, 2)
        ratio = loop / together
        reached &= ratio >= WANTED
        line(
            f"kinematics {name}: loop {loop:.2f} s, batch {1000 * together:.1f} ms",
            f"{ratio:.0f} x",
            f">= {WANTED:.0f}",
            ratio >= WANTED,
        )
    return reached
