"""Section of revisited poses: pose accuracy and repeatability according to ISO 9283."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from calib.array import Array
from calib.data import Dataset
from calib.model import ModelStructure
from calib.validation import VISITS_OF_THE_STANDARD, PoseFigures, judge_repeats
from service import wording

_MOST = 24  # poses listed; the worst repeatability first


def section_of(dataset: Dataset, model: ModelStructure, estimate: Array) -> dict[str, Any] | None:
    """Build the rows of the table and the text next to it; None if no pose was visited again."""
    poses = judge_repeats(dataset, model, estimate).poses
    if not poses:
        return None
    worst_first = sorted(poses, key=lambda pose: -_known(pose.repeatability))
    shown, short = worst_first[:_MOST], sum(pose.visits < VISITS_OF_THE_STANDARD for pose in poses)
    return {
        "rows": [_row(dataset, pose) for pose in shown],
        "more": max(len(poses) - _MOST, 0),
        "summary": _summary(poses),
        "standard": VISITS_OF_THE_STANDARD,
        "varied": any(pose.variation is not None for pose in shown),
        "blank": any(math.isnan(pose.repeatability) for pose in shown),
        "enough": not short,
        "fewer": "none has them" if short == len(poses) else f"{short} of {len(poses)} have fewer",
    }


def _summary(poses: Sequence[PoseFigures]) -> str:
    spreads = [pose.repeatability for pose in poses if math.isfinite(pose.repeatability)]
    said = f"{wording.counted(len(poses), 'pose')} visited again; AP at most {max(p.accuracy for p in poses):.3f} mm"
    return said + (f", RP at most {max(spreads):.3f} mm." if spreads else "; no side of approach came twice.")


def _row(dataset: Dataset, pose: PoseFigures) -> tuple[str, str, str, int, int, str, str, str]:
    """First reading, target, joints in deg or mm, visits, directions, AP, RP, vAP."""
    conditions, row = dataset.conditions, pose.reading
    joints = conditions.joints[row] / dataset.header.robot.joint_units
    return (
        dataset.reading_id[row],
        conditions.target_names[int(conditions.target[row])],
        " ".join(f"{angle:.1f}".replace("-", "−") for angle in joints),
        pose.visits,
        pose.directions,
        f"{pose.accuracy:.3f}",
        f"{pose.repeatability:.3f}" if math.isfinite(pose.repeatability) else "",
        "" if pose.variation is None else f"{pose.variation:.3f}",
    )


def _known(value: float) -> float:
    return value if math.isfinite(value) else -1.0
