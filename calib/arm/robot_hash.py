"""The hash of a robot: everything of it that moves it, and nothing that only describes it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict

from calib.arm.robot import Robot

DESCRIPTION = ("name", "maker", "source", "capsules")
"""Keys of a robot that are words, or its capsules, and move nothing."""


def robot_hash(robot: Robot) -> str:
    """SHA-256 of everything of a robot that moves it; of a robot without slides what older versions made of it."""
    table = {key: value for key, value in asdict(robot).items() if key not in DESCRIPTION}
    table = {key: value for key, value in table.items() if key not in ("slides", "external") or value}
    return hashlib.sha256(json.dumps(table, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
