"""Model written in another program's format, with the lost content and its error.

It also compares every format.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib.arm import refuse_slides
from calib.array import Array
from calib.compensate import Mounting, RepresentableModel, Usable, carried, mounting_of, poses_with
from calib.data import Dataset
from calib.errors import DataError
from calib.fit import ErrorStatistics
from calib.model import StatedConditions
from calib.saved import SIMULATED, CalibratedModel
from service.exports.formats import FORMATS, ExportRequest
from service.programs.compensation import of_carried
from service.programs.conditions import stated_conditions
from service.results.common import ErrorStatisticsResponse
from service.results.models.exported import ExportChoice, ExportChoices, few

FORMAT = "truepose-model-export/1"
_DRAWN = 1000
_LEAST_POSTURES = 12  # six numbers of each; a chain of six joints shows some 36
_ANY_HASH = "calib_"  # a hash changes no number


@dataclass(frozen=True)
class ExportedFile:
    """The text of a file, the document for programs, and lines for people.

    The lines are `about` the file, and `notes` of caution.
    """

    text: str
    document: dict[str, Any]
    about: tuple[str, ...]
    notes: tuple[str, ...]


def refuse_unknown(kind: str) -> None:
    """Raise DataError for a format that there is not."""
    if kind not in FORMATS:
        raise DataError(f"'{kind}' is not a known format.", do=f"Use {', '.join(FORMATS)}.", key="--format")


def written(
    saved: CalibratedModel,
    usable: Usable,
    name: str,
    kind: str,
    conditions: str | None,
    robot_hash: str | None,
    data: Dataset | None = None,
) -> ExportedFile:
    """Write a model in another program's format.

    Parameters
    ----------
    saved, usable : CalibratedModel, Usable
        The model for corrections and the parts left out of it (`CalibratedModel.for_use`).
    name : str
        Name of the model for people.
    kind : str
        One of FORMATS.
    conditions : str, optional
        As for `stated_conditions`.
    robot_hash : str, optional
        Hash of a UR's own calibration.
    data : Dataset, optional
        Readings in whose postures the file must be close. Default: random postures within the measured ranges, or
        within the joint limits if the model does not state its ranges.

    Raises
    ------
    DataError
        The model cannot be written in this format.
    """
    refuse_unknown(kind)
    stated = stated_conditions(conditions, saved)
    form, robot = FORMATS[kind], saved.model.robot
    refuse_slides(robot, "tables of constants hold")
    form.suits(robot)
    found = carried(
        saved.model,
        saved.estimate,
        stated.stated,
        form.holds(robot),
        coupling=saved.coupling,
        joints=_measured(saved) if data is None else _postures(data, saved),
    )
    held_out = saved.held_out_rms_mm
    # Reading the file back gives the error of its own numbers; no reader minds the lines about it
    mounting = _mounting(saved, stated.stated)
    export = ExportRequest(robot, saved.coupling, found, (), robot_hash, saved.simulated, mounting)
    loss, nominal = _read_back(kind, export), found.off(poses_with(robot, found.joints, {}))
    predicted = _left(saved, usable, loss)
    about = _about(
        found,
        (loss, nominal),
        _judged_at(saved, data),
        form.says,
        stated.in_words,
        _own_error(saved),
        predicted,
    )
    about += form.notes(export)
    if data is not None:
        anywhere = carried(saved.model, saved.estimate, stated.stated, (), coupling=saved.coupling)
        off = anywhere.off(form.reads(form.writes(export), replace(export, carried=anywhere)))
        about += (f"Elsewhere, at random poses within the joint limits: {off.rms:.3f} mm RMS.",)
    elif found.left_out:
        about += (
            "truepose export --data DATA.csv fits it where the robot works, which is far closer there.",
        )
    heading = f"{robot.name}, from {Path(name).name}."
    told = (heading, *((SIMULATED,) if saved.simulated else ()), *about)
    text = form.writes(replace(export, about=told))
    document = {
        "format": FORMAT,
        "model": name,
        "robot": robot.name,
        "simulated": saved.simulated,
        "as": kind,
        "carries": form.says,
        "left_out": list(found.left_out),
        "conditions": stated.document,
        "loss_mm": asdict(loss),
        "nominal_mm": asdict(nominal),
        "held_out_rms_mm": held_out,
        "verified_rms_mm": saved.verified_rms_mm,
        "predicted_rms_mm": predicted,
        **of_carried(usable),
        "warnings": list(stated.notes),
    }
    return ExportedFile(text, document, about, stated.notes)


def listed(
    saved: CalibratedModel,
    usable: Usable,
    name: str,
    conditions: str | None = None,
    data: Dataset | None = None,
) -> ExportChoices:
    """List what every format carries, what it leaves out, and the error that its file leaves.

    The parameters are those of `written`; every error is that of the file which `written` would make.

    Raises
    ------
    DataError
        No format can hold the model, or the conditions or the readings cannot be used.
    """
    stated, robot = stated_conditions(conditions, saved), saved.model.robot
    refuse_slides(robot, "tables of constants hold")
    joints = _measured(saved) if data is None else _postures(data, saved)
    mounting = _mounting(saved, stated.stated)
    fitted: dict[tuple[str, ...], RepresentableModel] = {}
    choices = []
    for kind, form in FORMATS.items():
        try:
            form.suits(robot)
        except DataError as error:
            choices.append(
                ExportChoice(
                    kind=kind,
                    carries=form.says,
                    left_out=[],
                    left_mm=None,
                    loss_mm=None,
                    refused=f"{error.what[:1].upper()}{error.what[1:]} {error.do}",
                )
            )
            continue
        slots = form.holds(robot)
        if slots not in fitted:  # two formats may hold the same
            fitted[slots] = carried(
                saved.model, saved.estimate, stated.stated, slots, coupling=saved.coupling, joints=joints
            )
        export = ExportRequest(robot, saved.coupling, fitted[slots], (), _ANY_HASH, saved.simulated, mounting)
        loss = _read_back(kind, export)
        choices.append(
            ExportChoice(
                kind=kind,
                carries=form.says,
                left_out=list(fitted[slots].left_out),
                left_mm=_left(saved, usable, loss),
                loss_mm=ErrorStatisticsResponse.model_validate(loss),
                refused=None,
            )
        )
    return ExportChoices(
        format="truepose-model-exports/1",
        model=name,
        robot=robot.name,
        simulated=saved.simulated,
        held_out_rms_mm=saved.held_out_rms_mm,
        verified_rms_mm=saved.verified_rms_mm,
        holds_for=stated.in_words,
        judged_at=_judged_at(saved, data),
        exports=choices,
    )


def _mounting(saved: CalibratedModel, stated: StatedConditions) -> Mounting:
    return mounting_of(saved.model, saved.estimate, stated, [each.name for each in saved.dropped])


def _read_back(kind: str, export: ExportRequest) -> ErrorStatistics:
    """Return the errors of the numbers in a file against the whole model, mm."""
    form = FORMATS[kind]
    return export.carried.off(form.reads(form.writes(export), export))


def _own_error(saved: CalibratedModel) -> tuple[float, str] | None:
    """Return the RMS error that the whole model leaves, mm, and its source; None if unknown.

    Readings of the fit are no source.
    """
    if saved.held_out_rms_mm is not None:
        return saved.held_out_rms_mm, "the model's own {:.3f} mm on held-out readings"
    if saved.verified_rms_mm is not None:
        return saved.verified_rms_mm, "{:.3f} mm of the robot at new poses, driven with the whole correction"
    return None


def _left(saved: CalibratedModel, usable: Usable, loss: ErrorStatistics) -> float | None:
    """Return the RMS error that a file leaves, mm; None if the model's own error is not known.

    The robot was verified without the carried terms that no correction has: their loss is in that error.
    """
    verified = saved.held_out_rms_mm is None and not any(each.is_usable for each in usable.left_out)
    own = _own_error(saved)
    if own is None:
        return None
    of_terms = 0.0 if usable.loss is None or verified else usable.loss.rms
    return math.hypot(own[0], loss.rms, of_terms)


def _judged_at(saved: CalibratedModel, data: Dataset | None) -> str:
    if data is not None:
        return f"postures of {data.name}"
    within = "joint limits" if saved.holds_for.get("joints") is None else "measured joint ranges"
    return f"random poses within the {within}"


def _measured(saved: CalibratedModel) -> Array | None:
    """Draw joints (n, N) within the ranges in which the model was identified.

    It is None if the model does not state them.
    """
    ranges, robot = saved.holds_for.get("joints"), saved.model.robot
    if ranges is None:
        return None
    low, high = np.transpose(ranges) * robot.joint_units
    counted = np.random.default_rng(1).uniform(low, high, (_DRAWN, robot.joints))
    return robot.model_angles(counted, saved.coupling)


def _postures(data: Dataset, saved: CalibratedModel) -> Array:
    """Return the joints (n, N) of the readings that may enter a fit.

    Raises
    ------
    DataError
        They are of another robot, or too few.
    """
    if data.header.robot.name != saved.model.robot.name:
        raise DataError(
            f"is of the robot {data.header.robot.name}, the model of {saved.model.robot.name}.",
            do="Give readings of this robot.",
            file=data.path,
        )
    postures = np.unique(data.conditions.joints[data.fit_rows], axis=0)
    if len(postures) < _LEAST_POSTURES:
        raise DataError(
            f"holds {len(postures)} postures outside its validation set.",
            do=f"Give {_LEAST_POSTURES} or more, or leave --data out.",
            file=data.path,
        )
    return postures


def _about(
    found: RepresentableModel,
    off: tuple[ErrorStatistics, ErrorStatistics],
    where: str,
    says: str,
    holds_for: str,
    own: tuple[float, str] | None,
    predicted: float | None,
) -> tuple[str, ...]:
    """Return the cautions that people must know about the file.

    `off` has the errors of the file and of the nominal robot, in the poses `where`; `own` is that of `_own_error`.
    """
    loss, nominal = off
    lines = [f"Carries {says}. Holds for: {holds_for}."]
    if found.left_out:
        lines.append(
            f"Leaves out {few(found.left_out)}: its numbers are fitted to the whole model and take over what they can."
        )
    lines.append(
        f"Against the whole model: {loss.rms:.3f} mm RMS, {loss.max:.3f} mm at most, at "
        f"{loss.n} {where}; the nominal robot: {nominal.rms:.3f} mm RMS."
    )
    if own is not None and predicted is not None:
        error, how = own
        lines.append(f"Predicted error: {predicted:.3f} mm RMS, with {how.format(error)}.")
    else:
        lines.append("The model's own error on held-out readings is not known: the predicted error is more.")
    return tuple(lines)
