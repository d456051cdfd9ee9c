"""`truepose campaign rescue`: save what can be read of a damaged record."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from acquisition.record import FILE as RECORD_FILE
from acquisition.record import rescue
from service import wording
from service.commands import options
from service.files import STANDARD_OUTPUT, write_json
from service.printed.terminal import Terminal


def rescue_command(
    record: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the damaged record.")],
    out: Annotated[
        Path | None,
        typer.Argument(
            metavar="OUT", help="A new folder for the record; or OUT.csv for a data set. Else DIR-rescued."
        ),
    ] = None,
    json: options.Json = None,
) -> None:
    """Save what can be read of a damaged record into a new one. What was lost is said. DIR is left as it is."""
    place = out or record.with_name(f"{record.absolute().name}-rescued")
    written = options.files_of(place) if place.suffix == ".csv" else ()
    outputs = {"--json": json} | {f"OUT {file.suffix}": file for file in written}
    options.check_outputs(outputs, inputs=(record / RECORD_FILE,))
    rescued = rescue(record, place)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.rest()
        terminal.out.print(
            f"{place}: {rescued.saved} of {wording.counted(rescued.measured, 'reading')} saved.",
            soft_wrap=True,
        )
        for sentence in rescued.lost or ("Nothing was lost.",):
            terminal.note(sentence)
        if place.suffix != ".csv":
            terminal.note(f"Next: truepose campaign status {place}")
    named = {"format": "truepose-rescue/1", "record": str(record), "out": str(place)}
    write_json(named | asdict(rescued), json)
