"""`truepose fleet diagnose`: diagnose many data sets with many workers, each result once.

The results are in the store.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calib.diagnose import MOST_EFFECTS
from calib.errors import DataError
from fleet.diagnose import EngineGone
from fleet.errors import StoreGone
from service import exit_codes
from service.commands import options
from service.commands.history import VARIABLE, PlantStore
from service.files import STANDARD_OUTPUT
from service.printed.fleet_tables import FleetProgress, shown
from service.printed.terminal import Terminal
from service.private import owner_only
from service.results.fleet_diagnosed import FleetDiagnosed, FleetDiagnosisRequest
from service.results.shape import document_of


@owner_only()
def diagnose_command(
    data: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[DATA...]",
            help="Data sets, or folders of data sets, with their headers. Default: the data sets of the store.",
        ),
    ] = None,
    store: PlantStore = "",
    scheduler: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Address of a Dask scheduler, tls://HOST:PORT. Default: processes of this computer.",
        ),
    ] = "",
    workers: Annotated[
        int | None,
        typer.Option(
            min=1, max=1024, help="Number of processes of this computer. Default: one per processor."
        ),
    ] = None,
    most: Annotated[
        int, typer.Option("--max-effects", "--most", min=0, help="Largest number of effects to add.")
    ] = MOST_EFFECTS,
    changed_since: Annotated[
        str,
        typer.Option(
            metavar="VERSION",
            help="Other version of TruePose whose results are compared with those of this one.",
        ),
    ] = "",
    json: options.Json = None,
) -> None:
    """Diagnose many data sets. Data sets with a result of this version are not diagnosed again."""
    given = tuple(data or ())
    options.check_outputs({"--json": json}, inputs=given)
    if not store:
        raise DataError(
            "is missing: results are kept in a store.",
            do=f"Give sqlite:///FILE, or an address in {VARIABLE}.",
            key="--store",
        )
    if scheduler and workers is not None:
        raise DataError(
            "cannot be combined with --scheduler, which has its own workers.",
            do="Leave one out.",
            key="--workers",
        )
    asked = FleetDiagnosisRequest(given, store, workers, scheduler, most, changed_since)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        try:
            found = FleetDiagnosed.of(
                asked, terminal.say, lambda text: terminal.note(f"truepose: {text}"), FleetProgress(terminal)
            )
        except (EngineGone, StoreGone) as error:
            terminal.rest()
            terminal.note(f"truepose: {error}")
            raise typer.Exit(exit_codes.NOT_AVAILABLE) from error
        result = found.result
        options.write_result(document_of(result), json, terminal)
        terminal.rest()
        for each in shown(result, found):
            terminal.out.print(each)
    if found.tally.failed:
        terminal.note(f"truepose: {len(found.tally.failed)} of the data sets have no result.")
        raise typer.Exit(exit_codes.FAILED)
