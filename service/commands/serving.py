"""Options that every server of the program has."""

from __future__ import annotations

from typing import Annotated

import typer

Host = Annotated[str, typer.Option(help="Address to listen on.")]
Hello = Annotated[bool, typer.Option("--json", help="Print one JSON line with url and tokens, for programs.")]
Log = Annotated[
    str | None,
    typer.Option(
        metavar="FILE", help="File for a log of JSON lines, one per request; '-' is standard error."
    ),
]
