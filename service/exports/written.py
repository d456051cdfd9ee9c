"""A model written in another program's format, with what that format leaves out and the error that this leaves."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from calib.arm import refuse_slides
from calib.compensate import Carried, Usable, carried
from calib.errors import DataError
from calib.saved import SIMULATED, SavedModel
from service.exports.formats import FORMATS, Export
from service.programs.conditions import stated_conditions
from service.programs.summary import of_carried

FORMAT = "truepose-model-export/1"
_NAMED = 6  # parameters named in one line; the document names all


@dataclass(frozen=True)
class Written:
    """The file's text, the document for programs, and lines for people: `about` the file, and `notes` of caution."""

    text: str
    document: dict[str, Any]
    about: tuple[str, ...]
    notes: tuple[str, ...]


def refuse_unknown(kind: str) -> None:
    """Raise DataError for a format that there is not."""
    if kind not in FORMATS:
        raise DataError(f"'{kind}' is not a known format.", do=f"Use {', '.join(FORMATS)}.", key="--as")


def written(
    saved: SavedModel,
    usable: Usable,
    name: str,
    kind: str,
    conditions: str | None,
    robot_hash: str | None,
) -> Written:
    """Write the model that people know by `name`. Raises DataError.

    saved, usable: the model for corrections and what it leaves out (`SavedModel.for_use`); kind: one of FORMATS;
    conditions: as `stated_conditions` takes them; robot_hash: that of a UR's own calibration.
    """
    refuse_unknown(kind)
    stated = stated_conditions(conditions, saved)
    form, robot = FORMATS[kind], saved.model.robot
    refuse_slides(robot, "tables of constants hold")
    found = carried(saved.model, saved.estimate, stated.stated, form.holds(robot), coupling=saved.coupling)
    held_out = saved.held_out_rms_mm
    parts = [held_out, found.loss.rms, 0.0 if usable.loss is None else usable.loss.rms]
    predicted = None if held_out is None else math.hypot(*(part for part in parts if part is not None))
    about = _about(found, form.says, stated.in_words, held_out, predicted)
    heading = f"{robot.name}, from {Path(name).name}."
    told = (heading, *((SIMULATED,) if saved.simulated else ()), *about)
    text = form.writes(Export(robot, saved.coupling, found, told, robot_hash, saved.simulated))
    document = {
        "format": FORMAT,
        "model": name,
        "robot": robot.name,
        "simulated": saved.simulated,
        "as": kind,
        "carries": form.says,
        "left_out": list(found.left_out),
        "conditions": stated.document,
        "loss_mm": asdict(found.loss),
        "nominal_mm": asdict(found.nominal),
        "held_out_rms_mm": held_out,
        "predicted_rms_mm": predicted,
        **of_carried(usable),
        "warnings": list(stated.notes),
    }
    return Written(text, document, about, stated.notes)


def _about(
    found: Carried, says: str, holds_for: str, held_out: float | None, predicted: float | None
) -> tuple[str, ...]:
    """The cautions that people must know beside the file."""
    lines = [f"Carries {says}. Holds for: {holds_for}."]
    if found.left_out:
        more = len(found.left_out) - _NAMED
        names = ", ".join(found.left_out[:_NAMED]) + (f" and {more} more" if more > 0 else "")
        lines.append(f"Leaves out {names}.")
    lines.append(
        f"Against the whole model: {found.loss.rms:.3f} mm RMS, {found.loss.max:.3f} mm at most, at "
        f"{found.loss.n} random poses within the joint limits; the nominal robot: {found.nominal.rms:.3f} mm RMS."
    )
    if held_out is not None and predicted is not None:
        lines.append(
            f"Predicted error: {predicted:.3f} mm RMS, with the model's own {held_out:.3f} mm on held-out readings."
        )
    else:
        lines.append("The model's own error on held-out readings is not known: the predicted error is more.")
    return tuple(lines)
