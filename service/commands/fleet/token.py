"""`truepose fleet token`: a token for each cell of a plant, taken away one by one."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from calib.errors import DataError
from fleet.store import utc_now
from service.plant.own_tokens import May, allow, issue, read_tokens, revoke, robots_of
from service.private import owner_only

app = typer.Typer(help="Create and withdraw the access tokens of cells.")
File = Annotated[
    Path,
    typer.Option(
        "--file", metavar="FILE", help="File of the tokens, the one of 'fleet serve --cell-tokens'."
    ),
]
Name = Annotated[str, typer.Argument(metavar="NAME", help="Name of the cell in the store.")]
Robots = Annotated[
    list[str] | None,
    typer.Option(
        "--robot",
        metavar="TYPE:SERIAL",
        help="Type and serial number of a robot whose documents the cell may send; may be repeated. "
        "Default: all robots.",
    ),
]
_ANY = "truepose: the token of '{}' may write about any robot. Name those of the cell: truepose fleet token allow\n"


@app.command("add")
@owner_only()
def add_command(
    name: Name,
    file: File,
    role: Annotated[
        May,
        typer.Option(
            help="Role of the token: a cell adds documents under its name, a viewer reads everything."
        ),
    ] = "cell",
    robot: Robots = None,
) -> None:
    """Make a token and print it.

    The token is not stored, so put it into the cell's own token file (mode 0600).
    """
    typer.echo(issue(file, name, role, f"{utc_now():%Y-%m-%d}", robots_of(robot or [])))
    if role == "cell" and not robot:
        sys.stderr.write(_ANY.format(name))


@app.command("allow")
@owner_only()
def allow_command(name: Name, file: File, robot: Robots = None) -> None:
    """Let a token name these robots too.

    From the next request on it sends documents of no others.
    """
    if not robot:
        raise DataError("is missing.", do="Give TYPE:SERIAL.", key="--robot")
    allow(file, name, robots_of(robot))


@app.command("list")
def list_command(file: File) -> None:
    """Show who has a token: name, role, day, robots."""
    found = read_tokens(file)
    for each in found:
        named = " ".join(f"{robot.model}:{robot.serial}" for robot in each.robots)
        typer.echo(f"{each.name}\t{each.role}\t{each.made}\t{named}")
        if each.role == "cell" and not each.robots:
            sys.stderr.write(_ANY.format(each.name))
    if not found:
        sys.stderr.write(f"truepose: {file}: no cell has a token of its own yet.\n")


@app.command("revoke")
@owner_only()
def revoke_command(name: Name, file: File) -> None:
    """Take a token away.

    It is invalid from the next request on. The cell's documents wait in its outbox.
    """
    revoke(file, name)
    sys.stderr.write(f"truepose: '{name}' may send no more.\n")
