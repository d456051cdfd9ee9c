"""`truepose doctor`: check that the devices of a cell are ready for a campaign.

They must be present and the right ones. The command is read-only: nothing is armed, moved or set. It prints one
line per check, then one line with the verdict.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from acquisition import open_devices, read_cell
from acquisition.examination import CheckResult, Examination, examine
from service import exit_codes
from service.commands import options
from service.files import STANDARD_OUTPUT, write_json
from service.printed.terminal import Terminal
from service.results.cell.examined import ExaminationShown
from service.results.shape import document_of
from service.simulated_cell import simulated_cell

_STYLES = {"ok": "green", "note": "yellow", "fault": "bold red"}


def doctor_command(
    cell: Annotated[Path, typer.Argument(metavar="CELL.toml", help="Cell file.")],
    simulate: Annotated[
        bool,
        typer.Option("--simulate", help="Start the cell's simulators and examine them, not the devices."),
    ] = False,
    record: Annotated[
        Path, typer.Option("--record", metavar="DIR", help="Folder of records, whose free space is checked.")
    ] = Path(),
    json: options.Json = None,
) -> None:
    """Examine every device of a cell and list what to do. Nothing is armed, moved or set."""
    options.check_outputs({"--json": json}, inputs=(cell,))
    the_cell = read_cell(cell)
    with ExitStack() as stack:
        terminal = stack.enter_context(Terminal(quiet=json == STANDARD_OUTPUT))
        if simulate:
            terminal.say("starting the simulators of the cell")
            devices = stack.enter_context(simulated_cell(the_cell)).open(the_cell)
        else:
            devices = open_devices(the_cell)
        stack.enter_context(quiet_drivers())
        found = examine(the_cell, devices, record=record, simulated=simulate, progress=terminal.say)
        result = ExaminationShown.of(found)
        terminal.rest()
        terminal.out.print(table_of(found))
        terminal.out.print(Text(result.verdict, style=_STYLES["fault" if found.faults else "ok"]))
    write_json(document_of(result), json)
    if found.exit_code != exit_codes.DONE:
        raise typer.Exit(found.exit_code)


@contextmanager
def quiet_drivers() -> Iterator[None]:
    """Keep warnings of connecting drivers off the screen.

    The table shows them and does not overwrite the progress line.
    """
    log, nobody = logging.getLogger("drivers"), logging.NullHandler()
    log.addHandler(nobody)
    try:
        yield
    finally:
        log.removeHandler(nobody)


def table_of(found: Examination) -> Table:
    """Build the table: level, device, check and result, with the recommended action below it."""
    table = Table(box=None, show_header=False, pad_edge=False)
    for _ in range(3):
        table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    device = ""
    for finding in found.findings:
        first = finding.device if finding.device != device else ""
        device = finding.device
        table.add_row(
            Text(
                finding.level.upper() if finding.level == "fault" else finding.level, _STYLES[finding.level]
            ),
            Text(first, "bold"),
            finding.check,
            _words(finding),
        )
    return table


def _words(finding: CheckResult) -> Text:
    code = "" if finding.code is None else f" [{finding.code}]"
    text = Text(finding.found + code)
    if finding.do:
        text.append(f"\n-> {finding.do}", style="bold" if finding.level == "fault" else "")
    return text
