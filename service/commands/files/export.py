"""`truepose export`: write a model for another program, and report the lost content.

Another program's format cannot carry every part of a model.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calib.data import read_dataset
from calib.errors import DataError
from calib.saved import SIMULATED
from calib.text import replace_file
from service import wording
from service.commands import options
from service.exports import FORMATS, listed, refuse_unknown, written
from service.files import STANDARD_OUTPUT
from service.printed.tables import grid
from service.printed.terminal import Terminal
from service.results.models.exported import ExportChoices
from service.results.shape import document_of


def export_command(
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="Identified model.")],
    out: Annotated[Path | None, typer.Argument(metavar="OUT", help="File to write.")] = None,
    kind: Annotated[
        str | None,
        typer.Option("--format", "--as", metavar="NAME", help=f"Format to write: {', '.join(FORMATS)}."),
    ] = None,
    list_all: Annotated[
        bool,
        typer.Option(
            "--list",
            help="Write nothing: list the parameters that every format can hold and the error that it leaves.",
        ),
    ] = False,
    conditions: Annotated[
        str | None,
        typer.Option(
            metavar="KEY=VALUE,...",
            help="Conditions (load, temperature, time, ...) for which the export holds, as for compensate.",
        ),
    ] = None,
    robot_hash: Annotated[
        str | None,
        typer.Option(
            "--hash",
            metavar="calib_...",
            help="Calibration hash of the robot itself, for the format ur-yaml.",
        ),
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="DATA.csv",
            help="Readings in whose postures the export approximates the model. "
            "Default: random postures within the measured ranges.",
        ),
    ] = None,
    named_only: options.NamedOnly = False,
    robot_file: options.RobotFile = None,
    largest_correction: options.LargestCorrection = options.LARGEST,
    json: options.Json = None,
) -> None:
    """Write a model in another program's format. The error that this format leaves is reported."""
    for given, key, do in (
        (out, "OUT", "Name the file to write"),
        (kind, "--format", "Choose what to write"),
    ):
        if list_all and given is not None:
            raise DataError("is not used by --list.", do="Leave one of the two out.", key=key)
        if not list_all and given is None:
            raise DataError(
                "is missing.", do=f"{do}; --list shows the error that each format leaves.", key=key
            )
    options.check_outputs({"OUT": out, "--json": json}, inputs=(model, *options.files_of(data)))
    if kind is not None:
        refuse_unknown(kind)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {model}")
        saved, usable = options.read_for_use(model, robot_file, largest_correction, named_only=named_only)
        options.note_without_regression(saved, terminal)
        readings = None if data is None else read_dataset(data)
        if out is None or kind is None:
            choices = listed(saved, usable, str(model), conditions, readings)
            options.write_result(document_of(choices), json, terminal)
            terminal.rest()
            _show(choices, terminal)
            return
        done = written(saved, usable, str(model), kind, conditions, robot_hash, readings)
        options.write_result({**done.document, "out": str(out)}, json, terminal)
        replace_file(out, done.text)
        terminal.rest()
        for line in done.about:
            terminal.out.print(line)
        for note in done.notes:
            terminal.note(f"truepose: {note}")
        terminal.note(f"export: {out}")


def _show(choices: ExportChoices, terminal: Terminal) -> None:
    """Print what every format leaves."""
    table = grid("What every format leaves, mm RMS", "format", "carries", "leaves out", "left", left=3)
    for each in choices.written:
        left = "unknown" if each.left_mm is None else wording.millimetres(each.left_mm)
        table.add_row(each.kind, each.carries, each.lost, left)
    terminal.out.print(table)
    for line in choices.refusals:
        terminal.out.print(line)
    terminal.out.print(
        f"Holds for: {choices.holds_for}. Left: at {choices.judged_at}, with the model's own error on held-out "
        "readings."
    )
    if choices.simulated:
        terminal.note(SIMULATED)
