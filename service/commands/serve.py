"""`truepose serve`: the HTTP service, on loopback unless a token was chosen for more."""

from __future__ import annotations

import ipaddress
import os
import secrets
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from acquisition import read_cell
from calib.errors import DataError
from service import exit_codes

TOKEN_VARIABLE = "TRUEPOSE_TOKEN"
SHORTEST_TOKEN = 16


def serve(
    cell: Annotated[
        Path | None, typer.Option(metavar="CELL.toml", help="The cell; without it nothing can be measured.")
    ] = None,
    simulate: Annotated[bool, typer.Option("--simulate", help="Measure with the cell's simulators.")] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: a free one.")] = 0,
    record: Annotated[Path, typer.Option(metavar="DIR", help="Folder for everything that is kept.")] = Path(
        "truepose-record"
    ),
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    token_file: Annotated[
        Path | None, typer.Option(metavar="FILE", help=f"File with the token; else {TOKEN_VARIABLE}.")
    ] = None,
) -> None:
    """Serve HTTP; prints one JSON line with url and token when ready. Nothing moves until it is asked to."""
    token = _token(token_file)
    if token is None and not is_loopback(host):
        sys.stderr.write(
            f"truepose: refused to listen on {host} without a token of your own: everybody on that network could "
            f"move the robot. Set {TOKEN_VARIABLE} or give --token-file.\n"
        )
        raise typer.Exit(exit_codes.REFUSED)
    if simulate and cell is None:
        raise DataError("needs a cell to simulate.", do="Give --cell CELL.toml.", key="--simulate")
    the_cell = None if cell is None else read_cell(cell)
    # the service takes long to import, and every other command would have to wait for it
    from service.http.app import create_app
    from service.http.server import run_server
    from service.http.settings import Settings
    from service.simulated_cell import simulated_cell

    with ExitStack() as stack:
        simulated = None
        if simulate and the_cell is not None:
            simulated = stack.enter_context(simulated_cell(the_cell))
        settings = Settings(
            record=record.absolute(),
            token=token or secrets.token_urlsafe(32),
            cell=the_cell,
            simulated=simulated,
            host=host,
        )
        code = run_server(create_app(settings), settings, port)
    if code != exit_codes.DONE:
        raise typer.Exit(code)


def is_loopback(host: str) -> bool:
    """Nobody but this computer can reach it."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def _token(file: Path | None) -> str | None:
    """The token chosen by the user, from file or environment; None where there is none."""
    if file is not None:
        text, where = file.read_text(encoding="utf-8").strip(), str(file)
    else:
        text, where = os.environ.get(TOKEN_VARIABLE, "").strip(), TOKEN_VARIABLE
        if not text:
            return None
    if len(text) < SHORTEST_TOKEN or not text.isascii() or not text.isprintable() or " " in text:
        raise DataError(
            "is not a usable token.",
            do=f"Use at least {SHORTEST_TOKEN} letters, digits and signs, without spaces.",
            key=where,
        )
    return text
