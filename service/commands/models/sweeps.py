"""`truepose sweeps`: errors, reversals and circle axes of joints that were turned alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calib.data import LEVELS, read_dataset
from calib.errors import DataError
from calib.fit import identify
from calib.sweeps import analyse
from calib.text import replace_file
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed import sweeps_tables
from service.printed.terminal import Terminal
from service.results.models import swept


def sweeps_command(
    data: options.Data,
    level: options.Level = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE.svg", help="Draw the tangential error of every joint.")
    ] = None,
    json: options.Json = None,
) -> None:
    """Show what single joints do while they alone turn. Source: Nubiola, thesis, 2.4.1."""
    options.check_outputs({"--json": json, "--picture": picture}, inputs=options.files_of(data))
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {data}")
        dataset = read_dataset(data)
        found = analyse(dataset)  # refused before the fit, not after it
        remarks = []
        try:
            identified = identify(
                dataset, groups=None if level is None else LEVELS[level], progress=terminal.say
            )
        except DataError as error:
            remarks.append(f"The axes are given alone, since no arm could be identified: {error}")
        else:
            found = analyse(dataset, identified)
        options.write_result(swept.document(dataset, found, remarks), json, terminal)
        if picture is not None:
            # drawing is not needed for the numbers, and takes long to import
            from service.report.figures.sweeps import sweeps_picture

            terminal.say("drawing the picture")
            replace_file(picture, sweeps_picture(found))
        terminal.rest()
        for shown in sweeps_tables.tables(found, remarks):
            terminal.out.print(shown)
        if picture is not None:
            terminal.note(f"picture: {picture}")
