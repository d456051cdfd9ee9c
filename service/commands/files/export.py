"""`truepose export`: write a model for another program, and report the lost content.

Another program's format cannot carry every part of a model.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calib.data import read_dataset
from calib.text import replace_file
from service.commands import options
from service.exports import FORMATS, refuse_unknown, written
from service.files import STANDARD_OUTPUT
from service.printed.terminal import Terminal


def export_command(
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="The identified model.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The file to write.")],
    kind: Annotated[
        str, typer.Option("--format", "--as", metavar="NAME", help=f"What to write: {', '.join(FORMATS)}.")
    ],
    conditions: Annotated[
        str | None,
        typer.Option(metavar="KEY=VALUE,...", help="For which conditions it holds, as for compensate."),
    ] = None,
    robot_hash: Annotated[
        str | None,
        typer.Option("--hash", metavar="calib_...", help="ur-yaml: the robot's own calibration hash."),
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="DATA.csv",
            help="What the format cannot hold is taken over as far as can be in the postures of these readings. "
            "Default: in random ones within the measured ranges.",
        ),
    ] = None,
    named_only: options.NamedOnly = False,
    robot_file: options.RobotFile = None,
    largest_correction: options.LargestCorrection = options.LARGEST,
    json: options.Json = None,
) -> None:
    """Write a model in another program's format. The error that this format leaves is reported."""
    options.check_outputs({"OUT": out, "--json": json}, inputs=(model, *options.files_of(data)))
    refuse_unknown(kind)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {model}")
        saved, usable = options.read_for_use(model, robot_file, largest_correction, named_only=named_only)
        options.note_without_regression(saved, terminal)
        done = written(
            saved,
            usable,
            str(model),
            kind,
            conditions,
            robot_hash,
            None if data is None else read_dataset(data),
        )
        options.write_result({**done.document, "out": str(out)}, json, terminal)
        replace_file(out, done.text)
        terminal.rest()
        for line in done.about:
            terminal.out.print(line)
        for note in done.notes:
            terminal.note(f"truepose: {note}")
        terminal.note(f"export: {out}")
