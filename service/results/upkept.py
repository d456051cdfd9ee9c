"""Thermal upkeep, for the command line (`truepose-upkeep/1`): what the readings say of the warmth of the arm.

The origin of a verdict: by it a store knows of which robot it is, and from when.
"""

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
from calib.text import written_by
from calib.units import to_display
from calib.watch import ThermalUpdate
from service import exit_codes
from service.json_values import finite

FORMAT = "truepose-upkeep/1"


@dataclass(frozen=True)
class ThermalUpdateRequest:
    """The question: how to update. update: file, None for none; rate: of false alarms; running_s: how long the robot
    had run, from cold, when the readings began, None if not stated; missing_allowed: whether readings may be
    missing."""

    update: Path | None = None
    rate: float = watch.RATE
    running_s: float | None = None
    missing_allowed: bool = False


@dataclass(frozen=True)
class ThermalUpdateSummary:
    """The result and what else is said of it."""

    dataset: Dataset
    model: Path
    asked: ThermalUpdateRequest
    found: ThermalUpdate
    notes: tuple[str, ...]

    @staticmethod
    def of(
        dataset: Dataset,
        saved: CalibratedModel,
        model: Path,
        asked: ThermalUpdateRequest,
        say: Callable[[str], None] = silent,
    ) -> ThermalUpdateSummary:
        """Test the rest, update the thermal parameters, write the model. Raises DataError, OSError."""
        watch.refuse_copies(dataset)
        notes = saved.notes + watch.refuse_unlike(
            saved,
            dataset,
            model,
            frame_known=True,
            missing_allowed=asked.missing_allowed,
            warmth_known=False,
        )
        dataset = on_its_clock(saved, dataset, model, asked.running_s)
        say("judging")
        found = watch.keep_up(saved, dataset, asked.rate, path=model)
        if asked.update is not None and found.model is not None:
            kept = found.model
            changed = [
                {"name": p.name, "value": _shown(v, p.unit), "u": _shown(2.0 * s, p.unit), "unit": p.unit}
                for p, v, s in zip(
                    found.parameters, found.change, np.sqrt(np.diag(found.covariance)), strict=True
                )
            ]
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
                    "changed": changed,
                },
            )
        return ThermalUpdateSummary(dataset, model, asked, found, notes)

    @property
    def thermal(self) -> bool:
        """Whether only thermal parameters have changed, or nothing."""
        return self.found.model is not None

    @property
    def exit_code(self) -> int:
        """0 where the update holds; 6 where something else has changed."""
        return exit_codes.DONE if self.thermal else exit_codes.UNKNOWN_CAUSE

    @property
    def in_words(self) -> str:
        """The finding, a sentence."""
        if self.thermal:
            return "What has changed is how warm the arm is, or nothing: the rest is chance."
        return f"Not updated: something else has changed. {self.found.rest.in_words}"

    @property
    def advice(self) -> str:
        """The advice, a sentence."""
        if not self.thermal:
            return "Measure the check poses of a watch, and judge them."
        return "Correct targets with the updated model." if self.asked.update else "Write it with --update."

    @property
    def rows(self) -> list[tuple[str, float, float, float, str]]:
        """The thermal parameters: of each name, value before, value now, its U (k = 2), and the unit."""
        found = self.found
        return [
            (p.name, _shown(b, p.unit), _shown(b + c, p.unit), _shown(2.0 * s, p.unit), p.unit)
            for p, b, c, s in zip(
                found.parameters,
                found.before,
                found.change,
                np.sqrt(np.diag(found.covariance)),
                strict=True,
            )
        ]

    def document(self) -> dict[str, Any]:
        """Document of the result, as JSON has it."""
        rest = self.found.rest
        return finite(
            {
                "format": FORMAT,
                **origin_of(self.dataset),
                "thermal": self.thermal,
                "exit_code": self.exit_code,
                "in_words": self.in_words,
                "advice": self.advice,
                "false_alarms": rest.rate,
                "t_squared": rest.questions[0].t_squared,
                "t_squared_limit": rest.questions[0].limit,
                "values": rest.questions[0].rows,
                "parameters": [
                    {"name": name, "before": before, "value": now, "u": u, "unit": unit}
                    for name, before, now, u, unit in self.rows
                ],
                "instead": [cause.label for cause, _ in rest.causes],
                "model": self.model.name,
                "data": self.dataset.name,
                "data_sha256": self.dataset.sha256,
                "updated_model": str(self.asked.update) if self.thermal and self.asked.update else None,
                "notes": list(self.notes),
            }
        )


def on_its_clock(saved: CalibratedModel, dataset: Dataset, model: Path, running_s: float | None) -> Dataset:
    """The readings on the clock of a model that warms up. Raises DataError where nobody said how long the robot had run
    before them."""
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
