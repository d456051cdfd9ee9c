"""`truepose sweeps`: errors, reversals and circle axes of joints that were turned alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calib.data import read_dataset
from calib.text import replace_file
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed import sweeps_tables
from service.printed.terminal import Terminal
from service.results.models.swept import SweepsResult
from service.results.shape import document_of


def sweeps_command(
    data: options.Data,
    level: options.Level = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE.svg", help="File for a picture of the tangential error of every joint."),
    ] = None,
    json: options.Json = None,
) -> None:
    """Analyse sweeps, in which one joint turns alone. Source: Nubiola, thesis, 2.4.1."""
    options.check_outputs({"--json": json, "--picture": picture}, inputs=options.files_of(data))
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {data}")
        found = SweepsResult.of(read_dataset(data), level, terminal.say)
        options.write_result(document_of(found), json, terminal)
        if picture is not None:
            # drawing is not needed for the numbers, and takes long to import
            from service.report.figures.sweeps import sweeps_picture

            terminal.say("drawing the picture")
            replace_file(picture, sweeps_picture(found.sweeps))
        terminal.rest()
        for shown in sweeps_tables.tables(found):
            terminal.out.print(shown)
        if picture is not None:
            terminal.note(f"picture: {picture}")
