"""`truepose export`: a model as another program reads it, with what that program's format cannot carry."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from calib.compensate import Carried, carried
from calib.errors import DataError
from calib.text import replace_file
from service.commands import options
from service.exports import FORMATS, Export
from service.files import STANDARD_OUTPUT
from service.printed.terminal import Terminal
from service.programs.conditions import stated_conditions

FORMAT = "truepose-model-export/1"
_NAMED = 6  # parameters named in one line; the JSON names all


def export_command(
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="The identified model.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The file to write.")],
    kind: Annotated[str, typer.Option("--as", metavar="NAME", help=f"What to write: {', '.join(FORMATS)}.")],
    conditions: Annotated[
        str | None,
        typer.Option(metavar="KEY=VALUE,...", help="For which conditions it holds, as for compensate."),
    ] = None,
    robot_hash: Annotated[
        str | None,
        typer.Option("--hash", metavar="calib_...", help="ur-yaml: the robot's own calibration hash."),
    ] = None,
    robot_file: options.RobotFile = None,
    largest_correction: options.LargestCorrection = options.LARGEST,
    json: options.Json = None,
) -> None:
    """Write a model in another program's format. The error that this format leaves is said."""
    options.check_outputs({"OUT": out, "--json": json}, inputs=(model,))
    if kind not in FORMATS:
        raise DataError(f"'{kind}' is not a known format.", do=f"Use {', '.join(FORMATS)}.", key="--as")
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {model}")
        saved = options.read_model(model, robot_file, largest_correction)
        options.note_without_regression(saved, terminal)
        stated = stated_conditions(conditions, saved)
        form = FORMATS[kind]
        robot = saved.model.robot
        found = carried(
            saved.model, saved.estimate, stated.stated, form.holds(robot), coupling=saved.coupling
        )
        held_out = saved.held_out_rms_mm
        about = _about(found, form.says, stated.in_words, held_out)
        text = form.writes(
            Export(robot, saved.coupling, found, (f"{robot.name}, from {model.name}.", *about), robot_hash)
        )
        document = {
            "format": FORMAT,
            "model": str(model),
            "robot": robot.name,
            "as": kind,
            "out": str(out),
            "carries": form.says,
            "left_out": list(found.left_out),
            "conditions": stated.document,
            "loss_mm": asdict(found.loss),
            "nominal_mm": asdict(found.nominal),
            "held_out_rms_mm": held_out,
            "predicted_rms_mm": _together(found.loss.rms, held_out),
            "warnings": list(stated.notes),
        }
        options.write_result(document, json, terminal)
        replace_file(out, text)
        terminal.rest()
        for line in about:
            terminal.out.print(line)
        for note in stated.notes:
            terminal.note(f"truepose: {note}")
        terminal.note(f"export: {out}")


def _about(found: Carried, says: str, holds_for: str, held_out: float | None) -> tuple[str, ...]:
    """What people must know beside the file."""
    lines = [f"Carries {says}. Holds for: {holds_for}."]
    if found.left_out:
        more = len(found.left_out) - _NAMED
        names = ", ".join(found.left_out[:_NAMED]) + (f" and {more} more" if more > 0 else "")
        lines.append(f"Leaves out {names}.")
    lines.append(
        f"Against the whole model: {found.loss.rms:.3f} mm RMS, {found.loss.max:.3f} mm at most, at "
        f"{found.loss.n} random poses within the joint limits; the nominal robot: {found.nominal.rms:.3f} mm RMS."
    )
    predicted = _together(found.loss.rms, held_out)
    if held_out is not None and predicted is not None:
        lines.append(
            f"Predicted error: {predicted:.3f} mm RMS, with the model's own {held_out:.3f} mm on held-out readings."
        )
    else:
        lines.append("The model's own error on held-out readings is not known: the predicted error is more.")
    return tuple(lines)


def _together(loss: float, held_out: float | None) -> float | None:
    return None if held_out is None else math.hypot(loss, held_out)
