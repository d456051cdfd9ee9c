"""The JSON document of `validate`, `truepose-validation/1`: lengths in mm, angles in mrad, null where there is nothing.

Every table of the command line is in it, and nothing that is not.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from calib.data import Dataset
from calib.validation import (
    VISITS_OF_THE_STANDARD,
    Difference,
    DistanceFigures,
    Grouping,
    HoldOutErrors,
    Judgement,
    PoseFigures,
    Repeats,
    SphereTest,
    Summary,
)
from service.results.models.documents import data_of, reading

VALIDATION_FORMAT = "truepose-validation/1"
MRAD = 1e3


def of_validation(
    dataset: Dataset,
    *,
    judged_on: str,
    placed: bool,
    judgements: Sequence[Judgement],
    repeats: Repeats,
    warnings: Sequence[str],
    comparison: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """The document where one or two models were judged. judged_on: "validation" or "all"."""
    return {
        "format": VALIDATION_FORMAT,
        "data": data_of(dataset),
        "judged_on": judged_on,
        "holdout": dataset.header.holdout if judged_on == "validation" else None,
        "placed": placed,
        "judgements": [_judgement(judgement) for judgement in judgements],
        "length_repeatability": None
        if repeats.lengths is None
        else {
            "poses": repeats.lengths.poses,
            "readings": repeats.lengths.readings,
            "std_mm": _number(repeats.lengths.std_mm),
            "worst_std_mm": _number(repeats.lengths.worst_mm),
        },
        "iso9283": {
            "visits_of_the_standard": VISITS_OF_THE_STANDARD,
            "poses": [_pose(dataset, pose) for pose in repeats.poses],
            "distances": [_distance(dataset, pair) for pair in repeats.distances],
        },
        "comparison": comparison,
        "warnings": list(warnings),
    }


def of_hold_outs(dataset: Dataset, held_out: Sequence[HoldOutErrors]) -> dict[str, Any]:
    """The document where no model was given."""
    return {
        "format": VALIDATION_FORMAT,
        "data": data_of(dataset),
        "hold_outs": [
            {
                "kind": each.kind,
                "folds": each.folds,
                "error_mm": summary_of(each.errors),
                "left_out": each.left_out,
            }
            for each in held_out
        ],
    }


def comparison_of(
    names: Iterable[str], parameters: Sequence[Difference], apart: Summary | None
) -> dict[str, Any]:
    """The part of the document that sets two calibrations side by side."""
    return {
        "models": list(names),
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "first": p.first,
                "u_first": p.u_first,
                "second": p.second,
                "u_second": p.u_second,
                "difference": p.difference,
                "e_n": p.e_n,
            }
            for p in parameters
        ],
        "prediction_difference_mm": summary_of(apart),
    }


def summary_of(summary: Summary | None, factor: float = 1.0) -> dict[str, Any] | None:
    """A summary as a dictionary, its figures times `factor`."""
    if summary is None:
        return None
    figures = ("mean", "std", "mean_3std", "rms", "p95", "max")
    return {"n": summary.n} | {name: _number(factor * getattr(summary, name)) for name in figures}


def _judgement(judgement: Judgement) -> dict[str, Any]:
    return {
        "model": judgement.name,
        "position_mm": summary_of(judgement.position),
        "length_mm": summary_of(judgement.length),
        "spheres": [_sphere(test) for test in judgement.spheres],
        "orientation_mrad": summary_of(judgement.orientation, MRAD),
        "pairs_mm": {series: summary_of(summary) for series, summary in judgement.pairs.items()},
        "groups": [
            _grouping(grouping, "length_mm" if judgement.position is None else "position_mm")
            for grouping in judgement.groupings
        ],
    }


def _sphere(test: SphereTest) -> dict[str, Any]:
    return {
        "tool_target": test.target,
        "base_target": test.base_target,
        "radius_mm": _number(test.radius_mm),
        "n": len(test.errors_mm),
        "mean_mm": _number(test.mean_mm),
        "std_mm": _number(test.std_mm),
        "max_mm": _number(test.largest_mm),
    }


def _grouping(grouping: Grouping, of: str) -> dict[str, Any]:
    return {"by": grouping.title, of: {name: summary_of(found) for name, found in grouping.groups}}


def _pose(dataset: Dataset, pose: PoseFigures) -> dict[str, Any]:
    return {
        "first_reading": reading(dataset.reading_id[pose.reading]),
        "visits": pose.visits,
        "directions": pose.directions,
        "AP_p_mm": _number(pose.accuracy),
        "RP_l_mm": _number(pose.repeatability),
        "vAP_p_mm": None if pose.variation is None else _number(pose.variation),
        "AP_xyz_mrad": _angles(pose.accuracy_angles),
        "RP_xyz_mrad": _angles(pose.repeatability_angles),
        "vAP_xyz_mrad": _angles(pose.variation_angles),
    }


def _distance(dataset: Dataset, pair: DistanceFigures) -> dict[str, Any]:
    return {
        "first_readings": [reading(dataset.reading_id[row]) for row in pair.readings],
        "visits": pair.visits,
        "AD_p_mm": _number(pair.accuracy),
        "RD_mm": _number(pair.repeatability),
    }


def _angles(angles: tuple[float, ...] | None) -> list[float | None] | None:
    return None if angles is None else [_number(MRAD * angle) for angle in angles]


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
