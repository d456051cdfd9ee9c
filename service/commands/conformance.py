"""`truepose conformance`: test a driver of another package on its own simulator.

The report states which of the promises of drivers it keeps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from service import exit_codes
from service.commands import options
from service.conformance import PromiseResult, bench_of, promises_of, tried
from service.files import STANDARD_OUTPUT, write_json
from service.printed.terminal import Terminal

WORDS = {True: ("yes", "green"), False: ("NO", "bold red"), None: ("not seen", "yellow")}


def conformance_command(
    driver: Annotated[
        str,
        typer.Argument(
            metavar="DRIVER",
            help="Name of the driver, as its package declares it. The package must also contain its test bench.",
        ),
    ],
    json: options.Json = None,
) -> None:
    """Try a driver of your own package on its simulator.

    The tests cover when it moves, how it stops, which answers it believes, and every fault of a connection. No
    device is needed and none is touched. Exit code 1 if a promise does not hold. The page 'truepose docs
    add-a-driver' lists the required parts of a package.
    """
    options.check_outputs({"--json": json})
    found: list[PromiseResult] = []
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        promises = promises_of(bench_of(driver))
        terminal.say(f"{driver}: {promises[0].text}")
        for finding in tried(driver):
            found.append(finding)
            if len(found) < len(promises):
                terminal.say(f"{driver}: {promises[len(found)].text}")
        terminal.rest()
        terminal.out.print(_table(found))
        broken = sum(each.holds is False for each in found)
        verdict = (
            f"{broken} of {len(found)} promises do not hold" if broken else f"all {len(found)} promises hold"
        )
        if weak := sum(each.holds is None for each in found):
            verdict += f"; {weak} faults cannot be seen on this wire"
        terminal.out.print(Text(f"{driver}: {verdict}.", style="bold red" if broken else "green"))
    write_json({"driver": driver, "holds": not broken, "promises": [asdict(each) for each in found]}, json)
    if broken:
        raise typer.Exit(exit_codes.FAILED)


def _table(found: Sequence[PromiseResult]) -> Table:
    """Build the table: each promise, whether it holds, and the observation if it does not."""
    table = Table(box=None, pad_edge=False)
    table.add_column("promise", no_wrap=True)
    table.add_column("holds", no_wrap=True)
    table.add_column("s", justify="right")
    table.add_column("seen", overflow="fold")
    for each in found:
        word, style = WORDS[each.holds]
        table.add_row(each.promise, Text(word, style=style), f"{each.seconds:.1f}", each.seen)
    return table
