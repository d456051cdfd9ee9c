"""Thermal upkeep (`truepose-upkeep/1`): what the readings say of the warmth of the arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib import watch
from calib.data import Dataset
from calib.errors import DataError
from calib.fit import silent
from calib.saved import CalibratedModel, save_update
from calib.units import to_display
from service import exit_codes
from service.results.watch_answers import UpkeepResult

FORMAT = "truepose-upkeep/1"


@dataclass(frozen=True)
class ThermalUpdateRequest:
    """Request for a thermal update.

    Attributes
    ----------
    update
        File of the updated model; None to write none.
    rate
        False-alarm rate.
    running_s
        Time from the cold start of the robot to the first reading, s; None if it is not stated.
    missing_allowed
        Whether readings may be missing.
    """

    update: Path | None = None
    rate: float = watch.RATE
    running_s: float | None = None
    missing_allowed: bool = False


def upkeep_result(
    dataset: Dataset,
    saved: CalibratedModel,
    model: Path,
    asked: ThermalUpdateRequest,
    say: Callable[[str], None] = silent,
) -> UpkeepResult:
    """Test the rest, update the thermal parameters, write the model. Raises DataError, OSError."""
    watch.refuse_copies(dataset)
    notes = saved.notes + watch.refuse_unlike(
        saved, dataset, model, frame_known=True, missing_allowed=asked.missing_allowed, warmth_known=False
    )
    dataset = on_its_clock(saved, dataset, model, asked.running_s)
    say("judging")
    found = watch.keep_up(saved, dataset, asked.rate, path=model)
    kept, rest = found.model, found.rest
    thermal = kept is not None
    each = list(
        zip(found.parameters, found.before, found.change, np.sqrt(np.diag(found.covariance)), strict=True)
    )
    if asked.update is not None and kept is not None:
        occasion = dataset.header.occasion
        save_update(
            asked.update,
            model,
            kept.model,
            kept.estimate,
            kept.covariance,
            {
                "by": "truepose watch thermal",
                "measured": None if occasion is None else occasion.began,
                "data": dataset.name,
                "data_sha256": dataset.sha256,
                "cause": "thermal",
                "class": ["thermal"],
                "changed": [_changed(p.name, p.unit, c, s) for p, _, c, s in each],
            },
        )
    if not thermal:
        in_words = f"Not updated: something else has changed. {rest.in_words}"
        advice = "Measure the check poses of a watch, and judge them."
    else:
        in_words = "What has changed is how warm the arm is, or nothing: the rest is chance."
        advice = "Correct targets with the updated model." if asked.update else "Write it with --update."
    said = {
        "format": FORMAT,
        "thermal": thermal,
        "exit_code": exit_codes.DONE if thermal else exit_codes.UNKNOWN_CAUSE,
        "in_words": in_words,
        "advice": advice,
        "t_squared": rest.questions[0].t_squared,
        "t_squared_limit": rest.questions[0].limit,
        "values": rest.questions[0].rows,
        "parameters": [
            {"before": _shown(b, p.unit), **_changed(p.name, p.unit, b + c, s)} for p, b, c, s in each
        ],
        "instead": [cause.label for cause, _ in rest.causes],
        "notes": notes,
    }
    return UpkeepResult.of(dataset, model, rest, asked.update if thermal else None, said)


def _changed(name: str, unit: str, value: float, std: float) -> dict[str, Any]:
    return {"name": name, "value": _shown(value, unit), "u": _shown(2.0 * std, unit), "unit": unit}


def on_its_clock(saved: CalibratedModel, dataset: Dataset, model: Path, running_s: float | None) -> Dataset:
    """Shift the readings to the clock of a model that warms up.

    Raises
    ------
    DataError
        The model warms up, but the time since the cold start is not stated.
    """
    if running_s is not None:
        return watch.later(dataset, running_s)
    if watch.warms_up(saved.model):
        raise DataError(
            "warms up with the time since a cold start, which is not stated.",
            do="Give --since-cold-start-s, 0 for a cold robot.",
            file=model,
            key="effects",
        )
    return dataset


def _shown(value: float, unit: str) -> float:
    return to_display(float(value), unit)
