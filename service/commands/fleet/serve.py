"""`truepose fleet serve`: the server of a fleet, on loopback unless a token file was chosen."""

from __future__ import annotations

import sys
from contextlib import closing
from json import dumps
from pathlib import Path
from typing import Annotated

import typer

from service import exit_codes
from service.commands import serving
from service.commands.history import PlantStore
from service.http.access.connections import refuse_host
from service.json_log import json_log
from service.private import lasting_tokens, owner_only


@owner_only()
def serve_command(
    store: PlantStore,
    token_file: Annotated[
        Path,
        typer.Option(
            "--token-file",
            metavar="FILE",
            help="File with the cells' token (adds documents) in its first line and the viewer's (reads) "
            "in its second. It "
            "is made if it does not exist.",
        ),
    ],
    cell_tokens: Annotated[
        Path | None,
        typer.Option(
            "--cell-tokens",
            metavar="FILE",
            help="File with a token per cell, from 'truepose fleet token'. The first line of --token-file "
            "then cannot add documents.",
        ),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on, 0 for a free one.")] = 0,
    host: serving.Host = "127.0.0.1",
    name: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Name by which cells call this computer; may be repeated."),
    ] = None,
    json: serving.Hello = False,
    log: serving.Log = None,
) -> None:
    """Receive documents from the cells of a plant, and report the state of their robots. Nothing here moves a robot."""
    for each in (host, *(name or [])):
        refuse_host(each)
    tokens = lasting_tokens(token_file, first="cells'", harm="write to the store")
    from fleet.store import FleetStore
    from service.http.server import run_server
    from service.plant import FleetServerSettings, Senders, create_plant

    senders = Senders(tokens, cell_tokens)
    if free := ", ".join(senders.of_any_robot()):
        sys.stderr.write(
            f"truepose: these tokens may write about any robot: {free}. Name those of each cell: "
            "truepose fleet token allow\n"
        )
    with json_log(log), closing(FleetStore.open(store)) as opened:
        place = opened.place

        def hello(url: str) -> str:
            if json:
                said = {
                    "url": url,
                    "token": tokens.operator,
                    "viewer_token": tokens.viewer,
                    "token_file": str(token_file.absolute()),
                }
                return dumps(said)
            return "\n".join(
                (
                    f"Ready: documents are kept in {place}.",
                    f"  address        {url}",
                    f"  tokens are in  {token_file.absolute()}   (first line: the cells'; second: the viewer's)",
                    f"  robots         curl -H 'Authorization: Bearer VIEWER-TOKEN' {url}/api/v1/robots",
                    "Ctrl-C ends the server; cells keep what they have until it is back.",
                )
            )

        plant = create_plant(opened, FleetServerSettings(senders, host, tuple(name or ())))
        code = run_server(plant, host, port, senders, hello)
    if code != exit_codes.DONE:
        sys.stderr.write("truepose: the server did not start.\n")
        raise typer.Exit(code)
