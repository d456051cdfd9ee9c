"""Command line that serves simulated devices until SIGTERM or SIGINT.

`python -m mocks cell CELL.toml | abb | abb-simple | faro | ...` prints one JSON line per endpoint on standard
output. The exit code is 0, 2 for a wrong file, or 1 for a port that is taken.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import signal
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mocks.cell import Cell
from mocks.cell_file import CellFile, read_cell

PROGRAM = "truepose mock"  # as most people start it
_ALONE = ("abb", "abb-simple", "ctrack", "emscon", "fanuc", "fanuc-rmi", "faro", "leica", "ur", "yaskawa")
DEVICES = {name: (name,) for name in _ALONE} | {"qc20w": ("qc20w", "qc20w-serial")}
_LR_MATE = "fanuc-lrmate200ic"
ROBOTS = {
    "fanuc": _LR_MATE,
    "fanuc-rmi": _LR_MATE,
    "ur": "ur5",
    "yaskawa": "yaskawa-gp7",
}  # of a cell of one device, if not the usual arm


def arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog=PROGRAM, description="simulated devices on their real wire protocols"
    )
    parser.add_argument("name", choices=["cell", *sorted(DEVICES)])
    parser.add_argument("file", nargs="?", type=Path, help="CELL.toml, needed for `cell`")
    parser.add_argument("--port", type=int, default=0, help="of the first device, 0 for a free one")
    parser.add_argument("--dialect", help="of a device; a name that there is not lists those there are")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--time-scale", type=float)
    parsed = parser.parse_args(argv)
    if parsed.name == "cell" and parsed.file is None:
        parser.error("cell needs CELL.toml")
    if parsed.time_scale is not None and not parsed.time_scale > 0:
        parser.error("--time-scale must be positive")
    return parsed


def described(chosen: argparse.Namespace) -> CellFile:
    """Return the cell that the command line describes.

    Raises
    ------
    OSError, ValueError
        The cell file cannot be read, or it is wrong.
    """
    cell = CellFile() if chosen.file is None else read_cell(chosen.file)
    if chosen.name in ROBOTS:
        cell = replace(cell, robot=ROBOTS[chosen.name])
    if chosen.seed is not None:
        cell = replace(cell, seed=chosen.seed)
    if chosen.time_scale is not None:
        cell = replace(cell, time_scale=chosen.time_scale)
    if chosen.dialect is not None:
        cell = replace(cell, dialect=chosen.dialect)
    return cell


async def serve(cell: Cell, port: int) -> None:
    """Serve until a signal ends the process."""
    loop, end = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        try:
            # A plain handler may wait for ever: one that comes as the loop begins to wait is not run before it ends.
            loop.add_signal_handler(number, end.set)
        except NotImplementedError:  # Windows
            signal.signal(number, lambda *_: loop.call_soon_threadsafe(end.set))
    for endpoint in await cell.start(port):
        sys.stdout.write(json.dumps(endpoint.line()) + "\n")
    sys.stdout.flush()
    await end.wait()
    await cell.stop()


def main(argv: Sequence[str]) -> int:
    chosen = arguments(argv)
    try:
        file = described(chosen)
        devices = DEVICES.get(chosen.name, file.devices)
        cell = Cell(file, devices=devices)
    except (OSError, ValueError, TypeError, tomllib.TOMLDecodeError) as error:
        sys.stderr.write(f"{PROGRAM}: {error}\n")
        return 2
    try:
        asyncio.run(serve(cell, chosen.port))
    except OSError as error:
        sys.stderr.write(f"{PROGRAM}: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
