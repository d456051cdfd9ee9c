"""`truepose history`: documents of robots over the years.

It shows their trends, control charts and next checks. A command asks the store at an address, or in the file of
this cell.
"""

from __future__ import annotations

import socket
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from calib.errors import DataError
from calib.text import replace_file
from calib.upkeep import DriftInterval, InUse, Staircase
from fleet.outbox import CellFolder, read_data, read_result
from fleet.store import Document, utc_now
from service import exit_codes, wording
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed import history_tables
from service.printed.terminal import Terminal
from service.private import owner_only
from service.results import history as results
from service.results.history import read_hours
from service.results.robots import read_record

if TYPE_CHECKING:
    from fleet.store import FleetStore  # it loads the database library, which not every command needs

app = typer.Typer(help="Keep the results of robots over the years: trends, causes, dates of the next checks.")
Serial = Annotated[str, typer.Argument(metavar="SERIAL", help="Serial number of the robot.")]

Model = Annotated[
    str | None,
    typer.Option("--model", metavar="NAME", help="Type of the robot, if several have this serial number."),
]

_RECORD = "record.sqlite3"
_DAYS, _HOURS = (180.0, 7.0, 1825.0), (2000.0, 100.0, 20_000.0)  # first, shortest, longest interval
VARIABLE = "TRUEPOSE_STORE"
DEFAULT = Path("truepose-record") / "history.sqlite3"  # next to the files of `truepose serve`
_FILE = "sqlite:///"
_ADDRESS = "sqlite:///FILE or postgresql://USER@HOST/NAME"

StoreOption = Annotated[
    str | None,
    typer.Option(
        "--store",
        metavar="URL",
        envvar=VARIABLE,
        show_envvar=False,
        help=f"Address of the store, {_ADDRESS}. Passwords belong into {VARIABLE}. Default: {DEFAULT.as_posix()}.",
    ),
]

_PLANT: dict[str, Any] = {
    "metavar": "URL",
    "envvar": VARIABLE,
    "show_envvar": False,
    "help": f"{_ADDRESS}; or in {VARIABLE}, which other users do not see.",
}

StoreArgument = Annotated[str, typer.Argument(**_PLANT)]
PlantStore = Annotated[str, typer.Option("--store", **_PLANT)]


class Way(StrEnum):
    """Methods of ILAC-G24 for the next date."""

    staircase = "staircase"
    drift = "drift"


@app.command("add")
@owner_only()
def add_command(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE", help="Model, verdict, diagnosis, data set or folder of a record; may be repeated."
        ),
    ],
    store: StoreOption = None,
    cell: options.CellName = None,
    serial: options.Serial = "",
    simulated: Annotated[
        bool,
        typer.Option("--simulated", help="Keep documents of simulated robots too; use a separate store."),
    ] = False,
    json: options.Json = None,
) -> None:
    """Add documents to the store, each only once.

    Exit code 3 if one contradicts another of the same thing; both are kept.
    """
    options.check_outputs({"--json": json}, inputs=files)
    whose = CellFolder(socket.gethostname() if cell is None else cell, serial, simulated)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        read: list[tuple[Path, Document]] = []
        for file in files:
            terminal.say(f"reading {file}")
            read += [(file, document) for document in _documents(file, whose)]
        with opened(store, make=True) as kept:
            terminal.say(f"keeping {wording.counted(len(read), 'document')}")
            added = kept.add_all([document for _, document in read])
            place = kept.place
        told = results.added_document(
            [(document, its) for (_, document), its in zip(read, added, strict=True)]
        )
        options.write_result(told, json, terminal)
        terminal.rest()
        terminal.out.print(history_tables.added(place, read, added))
    if any(found.state == "conflict" for found in added):
        raise typer.Exit(exit_codes.NOT_MET)


@app.command("robots")
def robots_command(store: StoreOption = None, json: options.Json = None) -> None:
    """List the robots, with the number of documents of each."""
    options.check_outputs({"--json": json})
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal, opened(store) as kept:
        found = kept.robots()
        options.write_result(results.robots_document(found), json, terminal)
        terminal.rest()
        terminal.out.print(history_tables.robots(found))


@app.command("show")
def show_command(
    serial: Serial, store: StoreOption = None, model: Model = None, json: options.Json = None
) -> None:
    """Show all documents of one robot in the order of time."""
    options.check_outputs({"--json": json})
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal, opened(store) as kept:
        robot = results.robot_of(kept, serial, model)
        lines = results.lines_of(kept, robot)
        options.write_result(results.history_document(robot, lines), json, terminal)
        terminal.rest()
        terminal.out.print(history_tables.lines(robot, lines))
        last = next((line.said for line in reversed(lines) if line.said and line.said.advice), None)
        if last is not None:
            terminal.out.print(f"Last advice ({last.measured_at:%Y-%m-%d}): {last.advice}")


@app.command("retire")
@owner_only()
def retire_command(
    serial: Serial,
    because: Annotated[
        str,
        typer.Option(
            "--because", metavar="TEXT", help="Reason, such as 'controller exchanged, now 120-777'."
        ),
    ],
    store: StoreOption = None,
    model: Model = None,
    json: options.Json = None,
) -> None:
    """Mark a robot as no longer measured, so that it is never due. New readings of it reactivate it."""
    if not because.strip():
        raise DataError("is empty.", do="Give the reason.", key="--because")
    options.check_outputs({"--json": json})
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal, opened(store) as kept:
        robot = results.robot_of(kept, serial, model)
        document = results.retired(robot, socket.gethostname(), because.strip(), utc_now())
        told = results.added_document([(document, kept.add(document))])
        options.write_result(told, json, terminal)
        terminal.rest()
        terminal.out.print(f"{robot.serial} ({robot.model}) is retired; what is kept of it stays.")


@app.command("trend")
def trend_command(
    serial: Serial,
    parameter: Annotated[
        str | None,
        typer.Argument(
            metavar="PARAMETER",
            help="Name of the parameter in the model, or error_rms for the position error. Default: all.",
        ),
    ] = None,
    store: StoreOption = None,
    model: Model = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture", metavar="P.svg|P.png", help="File for a picture of the trend with its limits."
        ),
    ] = None,
    json: options.Json = None,
) -> None:
    """Show how a parameter has changed, with U and the limits of its control chart.

    Without a name, all parameters are shown.
    """
    from service.report.figures.trend_picture import ENDINGS, picture_bytes

    options.check_outputs({"--json": json, "--picture": picture})
    if picture is not None and (parameter is None or picture.suffix not in ENDINGS):
        raise DataError(
            "is a picture of one parameter, as SVG or PNG.",
            do="Name the PARAMETER, and a file that ends in .svg or .png.",
            file=f"--picture {picture}",
        )
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal, opened(store) as kept:
        robot = results.robot_of(kept, serial, model)
        trends = results.trends_of(kept, robot, parameter)
        options.write_result(results.trends_document(robot, trends), json, terminal)
        if picture is not None:
            terminal.say(f"drawing {picture}")
            replace_file(picture, picture_bytes(trends[0], picture.suffix))
        terminal.rest()
        if parameter is None:
            terminal.out.print(history_tables.overview(trends))
            return
        (trend,) = trends
        terminal.out.print(history_tables.values(trend))
        if trend.chart is None:
            terminal.note(f"no control chart: {trend.because}")
            return
        for signal in trend.chart.signals:
            terminal.out.print(signal.because)


@app.command("due")
def due_command(
    permitted: Annotated[
        float,
        typer.Option("--permitted", metavar="MM", min=1e-6, help="Largest permitted position error, mm RMS."),
    ],
    store: StoreOption = None,
    method: Annotated[
        Way,
        typer.Option(
            help="Rule for the interval: staircase (longer after good checks), or drift (check before the "
            "error is expected to exceed the permitted one)."
        ),
    ] = Way.staircase,
    first: Annotated[
        float | None, typer.Option(min=1.0, help="First interval. Default: 180 days, or 2000 h with --hours.")
    ] = None,
    shortest: Annotated[
        float | None, typer.Option(min=1.0, help="Shortest interval. Default: 7 days, or 100 h with --hours.")
    ] = None,
    longest: Annotated[
        float | None,
        typer.Option(min=1.0, help="Longest interval. Default: 1825 days, or 20000 h with --hours."),
    ] = None,
    hours: Annotated[
        Path | None,
        typer.Option(
            metavar="HOURS.csv",
            help="Readings of the robots' counters, columns serial,at,hours: intervals in hours of use, not in days.",
        ),
    ] = None,
    json: options.Json = None,
) -> None:
    """Show when each robot must be checked next, from its errors so far. Exit code 3 if a robot is overdue."""
    options.check_outputs({"--json": json}, inputs=(hours,))
    usual = _DAYS if hours is None else _HOURS
    asked = [
        own if given is None else given for given, own in zip((first, shortest, longest), usual, strict=True)
    ]
    kind = Staircase if method is Way.staircase else DriftInterval
    by = kind(asked[0], permitted, shortest=asked[1], longest=asked[2])
    way, counted = (by, None) if hours is None else (InUse(by), read_hours(hours))
    now = utc_now()
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal, opened(store) as kept:
        found = results.due_of(kept, way, now, counted)
        options.write_result(results.due_document(found, now), json, terminal)
        terminal.rest()
        terminal.out.print(history_tables.due(found, permitted))
    if any(each.overdue(now) for each in found):
        raise typer.Exit(exit_codes.NOT_MET)


def _documents(file: Path, cell: CellFolder) -> list[Document]:
    """Read the documents of one file or record.

    Raises
    ------
    DataError
        The file or record has no documents.
    """
    if file.is_dir():
        if not (file / _RECORD).is_file():
            raise DataError("is not the record of a campaign.", do="Name a record, or files.", file=file)
        found = read_record(file / _RECORD, cell)
        if not found:
            raise DataError(
                "is the record of a campaign that has not succeeded.",
                do=f"Continue it with: truepose campaign resume {file}",
                file=file,
            )
        return found
    if not file.is_file():
        raise DataError("there is no such file.", do="Check the name.", file=file)
    found = read_data(file, cell) if file.suffix == ".csv" else read_result(file, cell)
    if not found:
        raise DataError(
            "is not a document of this program.",
            do="Give models, verdicts of watches, diagnoses, data sets or records.",
            file=file,
        )
    return found


def opened(address: str | None, *, make: bool = False) -> FleetStore:
    """Open the store at an address, or this cell's store.

    With `make`, a missing store is created.

    Raises
    ------
    DataError
        The store cannot be opened.
    """
    from fleet.store import FleetStore

    own = f"sqlite:///{DEFAULT.absolute()}"
    if make:
        if address is None:
            DEFAULT.parent.mkdir(exist_ok=True)
    else:
        file = Path((address or own).removeprefix(_FILE))
        if (address or own).startswith(_FILE) and not file.exists():
            raise DataError(
                "there is no history here yet.",
                do="Name a store with --store URL, or begin one: truepose history add FILE...",
                file=file if address else DEFAULT,
            )
    return FleetStore.open(address or own)
