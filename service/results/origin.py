"""The origin of a verdict: by it a store knows of which robot it is, and from when."""

from __future__ import annotations

from typing import Any

from calib.data import Dataset
from calib.text import written_by


def origin_of(dataset: Dataset) -> dict[str, Any]:
    """Program, robot, devices and time of readings, as far as their header says."""
    header, occasion = dataset.header, dataset.header.occasion
    return {
        "program": written_by(),
        "robot": header.robot.name,
        "device": [dict(each) for each in header.devices],
        "measured": None if occasion is None else {"began": occasion.began, "ended": occasion.ended},
        "simulated": header.simulated,
    }
