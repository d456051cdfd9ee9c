"""The dialects and software versions that simulated devices can speak, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

Cell = Any  # `mocks.cell.Cell`, which imports this module


def _ours(_: Cell) -> None:
    """Leave the dialect as the cell was created with."""


def _stock(cell: Cell) -> None:
    cell.abb.stock = cell.fanuc.mappdk.stock = True


def _polyscope(
    software: tuple[int, int, int, int], closed: str = "", mode: str = "auto"
) -> Callable[[Cell], None]:
    def put(cell: Cell) -> None:
        cell.ur.software = software
        cell.ur.registers.served = software >= (3, 9)
        cell.ur.closed = set(closed.split())
        cell.arm.mode = mode

    return put


def _with_web_services(*, old: bool) -> Callable[[Cell], None]:
    """Serve Robot Web Services as well: 2 of an OmniCore, or the old ones of an IRC5."""

    def put(cell: Cell) -> None:
        cell.devices = (*cell.devices, "abb-rws")
        cell.rws.old = old

    return put


def _older_rmi(cell: Cell) -> None:
    cell.fanuc.rmi.version = (5, 0)


def _without_sums(cell: Cell) -> None:
    for bridge in cell.bridges:
        bridge.sums = False


_X = (10, 12, 0, 0)
_MBP: Mapping[str, Callable[[Cell], None]] = {"mbp1": _ours, "mbp1-plain": _without_sums}
# The dialects of each device; without one named it speaks the first, a UR the software of its series.
DIALECTS: Mapping[str, Mapping[str, Callable[[Cell], None]]] = {
    "abb": {
        "calsrv": _ours,
        "open_abb": _stock,
        "omnicore": _with_web_services(old=False),
        "irc5-rws1": _with_web_services(old=True),
    },
    "abb-simple": {"simple_message": _ours},
    "fanuc-rmi": {"rmi": _ours, "rmi-5": _older_rmi},
    "fanuc": {"mappdk-cal": _ours, "mappdk": _stock},  # Modbus is served in addition to either
    "ur": {
        "polyscope-3.15": _polyscope((3, 15, 8, 106339)),
        "polyscope-3.8": _polyscope((3, 8, 0, 61336)),  # without registers
        "polyscope-5.11": _polyscope((5, 11, 1, 108318)),
        "polyscope-5.21": _polyscope((5, 21, 0, 0), "realtime secondary dashboard"),  # what a person opened
        "polyscope-5.21-new": _polyscope((5, 21, 0, 0), "rtde realtime secondary primary dashboard"),
        "polyscope-x": _polyscope(_X, "realtime dashboard"),
        "polyscope-x-local": _polyscope(_X, "realtime dashboard", "manual"),
        "polyscope-x-primary": _polyscope(_X, "rtde realtime secondary dashboard"),
        "polyscope-x-new": _polyscope(_X, "rtde realtime secondary primary dashboard"),
    },
    "yaskawa": {"hses": _ours},
    "emscon": {"emscon": _ours},
    **dict.fromkeys(("ctrack", "faro", "leica", "qc20w"), _MBP),
}


def speak(cell: Cell, dialect: str) -> None:
    """Let the devices of the cell that know this dialect speak it.

    Raises
    ------
    ValueError
        No device of the cell knows the dialect; the message names the known ones.
    """
    known = {name: put for device in cell.devices for name, put in DIALECTS.get(device, {}).items()}
    if dialect not in known:
        raise ValueError(f"dialect {dialect}: there is {', '.join(known) or 'none to choose'} here.")
    known[dialect](cell)
