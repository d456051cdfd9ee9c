"""`truepose fleet token`: a token for each cell of a plant, taken away one by one."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from fleet.store import utc_now
from service.plant.own_tokens import May, issue, read_tokens, revoke
from service.private import owner_only

app = typer.Typer(help="Give each cell a token of its own, and take it away.")
File = Annotated[
    Path, typer.Option("--file", metavar="FILE", help="The file that 'fleet serve --cell-tokens' was given.")
]
Name = Annotated[str, typer.Argument(metavar="NAME", help="The cell, as the store shall name it.")]


@app.command("add")
@owner_only()
def add_command(
    name: Name,
    file: File,
    role: Annotated[
        May, typer.Option(help="cell: puts documents in under its name; viewer: reads everything.")
    ] = "cell",
) -> None:
    """Make a token and print it: it is kept nowhere, so put it into the cell's own token file (mode 0600)."""
    token = issue(file, name, role, f"{utc_now():%Y-%m-%d}")
    typer.echo(token)


@app.command("list")
def list_command(file: File) -> None:
    """Show who has a token: name, role, day."""
    found = read_tokens(file)
    for each in found:
        typer.echo(f"{each.name}\t{each.role}\t{each.made}")
    if not found:
        sys.stderr.write(f"truepose: {file}: no cell has a token of its own yet.\n")


@app.command("revoke")
@owner_only()
def revoke_command(name: Name, file: File) -> None:
    """Take a token away: it is worth nothing from the next request on; what the cell has waits in its outbox."""
    revoke(file, name)
    sys.stderr.write(f"truepose: '{name}' may send no more.\n")
