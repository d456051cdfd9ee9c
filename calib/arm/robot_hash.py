"""The hash of a robot: of all numbers on which its motion depends, and of no description."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict

from calib.arm.robot import Robot

DESCRIPTION = ("name", "maker", "source", "capsules")
"""Keys of a robot that are words, or its capsules, and move nothing."""


def robot_hash(robot: Robot) -> str:
    """SHA-256 of all numbers on which a robot's motion depends; without slides the same as in older versions.

    Estimated loads count as none: a better estimate makes no other robot, and models from before it stay valid.
    """
    table = {key: value for key, value in asdict(robot).items() if key not in DESCRIPTION}
    if table.pop("loads_estimated"):
        table["loads"] = ()
    table = {key: value for key, value in table.items() if key not in ("slides", "external") or value}
    return hashlib.sha256(json.dumps(table, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
