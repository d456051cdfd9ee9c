"""`truepose mock`: simulated devices on their real wire protocols, until a signal ends them."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Annotated

import typer

from calib.errors import DataError
from drivers import INSTRUMENTS, ROBOTS
from service import child
from service.simulated_cell import command_of

DEVICES = tuple(
    each.name for each in (*ROBOTS.values(), *INSTRUMENTS.values()) if not each.by_hand
)  # every driver has its simulator; a person is simulated in a cell alone
CELL = "cell"


def mock(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help=f"Device to simulate, or '{CELL}' for all devices of CELL.toml. Devices: {', '.join(DEVICES)}.",
        ),
    ],
    cell: Annotated[
        Path | None, typer.Argument(metavar="[CELL.toml]", help="Cell file, only after 'cell'.")
    ] = None,
    dialect: Annotated[
        str | None,
        typer.Option(
            help="Dialect of a device: 'open_abb', 'mappdk' (the one of fanucpy), 'mbp1-plain'. Any other "
            "name lists them."
        ),
    ] = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the first device, 0 for a free one.")
    ] = 0,
) -> None:
    """Simulate devices until SIGTERM or SIGINT. Prints one JSON line per endpoint."""
    _refuse(name, cell)
    arguments = [name, *([] if cell is None else [str(cell)]), "--port", str(port)]
    arguments += [] if dialect is None else ["--dialect", dialect]
    # In a separate session, so that Ctrl-C reaches it once, through us.
    code = child.run(command_of(*arguments), subprocess.Popen[bytes].send_signal, own_session=True)
    raise typer.Exit(code)


def _refuse(name: str, cell: Path | None) -> None:
    """Raise DataError for a device that is not simulated, and for a cell without its file."""
    if name not in (*DEVICES, CELL):
        raise DataError(
            f"'{name}' is not simulated.", do=f"Name {', '.join(DEVICES)}, or {CELL} CELL.toml.", key="NAME"
        )
    if name == CELL and cell is None:
        raise DataError("needs a cell file.", do=f"Give it: truepose mock {CELL} CELL.toml", key="CELL.toml")
    if cell is not None and not cell.is_file():
        raise DataError("there is no such file.", do="Check the name.", file=cell)
