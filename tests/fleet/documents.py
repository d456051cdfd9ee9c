"""Documents as cells write them, as small as they can be."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

from fleet.store import Document, Kind, RobotKey

ROBOT = RobotKey("120-4711", "irb120")
BEGAN = datetime(2026, 3, 2, 9, 15, tzinfo=UTC)


def model(
    values: Mapping[str, float],
    *,
    robot: RobotKey = ROBOT,
    day: float = 0,
    identity: str = "",
    std: float | None = 0.005,
) -> Document:
    """Return a model with these parameters, mm, measured `day` days after the first day."""
    entries = [
        {"name": name, "value": value, "std": std, "unit": "mm", "nominal": 0.0, "owner": "base model"}
        for name, value in values.items()
    ]
    table = {"format": "truepose-model/1", "program": "truepose 0.1.0", "parameters": entries}
    return of("model", table, robot=robot, day=day, identity=identity)


def watch(
    verdict: str = "changed", *, robot: RobotKey = ROBOT, day: float = 0, size: float = 0.031
) -> Document:
    """A watch that names one cause, but where nothing has changed."""
    cause = {
        "label": "joint_step:j4",
        "weight": 0.9,
        "size": {"value": size, "u": 0.004, "unit": "deg"},
        "parameters": [],
        "in_words": f"Joint 4 lost its zero by {size} deg.",
    }
    table = {
        "format": "truepose-watch/1",
        "verdict": verdict,
        "in_words": "Joint 4 lost its zero.",
        "advice": f"Re-zero joint 4 by {size} deg.",
        "causes": [] if verdict == "unchanged" else [cause],
    }
    return of("watch", table, robot=robot, day=day)


def of(
    kind: Kind, table: Mapping[str, Any], *, robot: RobotKey = ROBOT, day: float = 0, identity: str = ""
) -> Document:
    """A document of any kind."""
    moment = BEGAN + timedelta(days=day)
    named = identity or f"record-{robot.serial}-{day:g}:{kind}"
    content = {**table, "data": named}  # so that no two are the same by chance
    return Document(kind, robot, "cell-1", named, moment, json.dumps(content).encode())
