"""Details that a bridge reports beyond the status: clock (PING) and battery (STATUS)."""

from __future__ import annotations

from typing import Protocol

from drivers.bridge import mbp
from drivers.bridge.session import MbpSession
from drivers.details import Details
from drivers.interfaces import InstrumentStatus


class Bridged(Protocol):
    """An instrument behind a bridge."""

    @property
    def session(self) -> MbpSession: ...


def battery_of(device: Bridged, status: InstrumentStatus) -> Details:
    """Return the battery charge, if the bridge reports it with its status.

    Raises
    ------
    LinkError
        The connection failed.
    """
    return Details(battery_percent=_number_of(device, mbp.parse(status.raw), "batt"))


def clock_of(device: Bridged) -> float | None:
    """Return the instrument's own clock, s.

    Raises
    ------
    LinkError
        The connection failed.
    """
    return _number_of(device, device.session.ask("PING", {}), "t")


def _number_of(device: Bridged, reply: mbp.Message, key: str) -> float | None:
    with device.session.understood():
        return mbp.number(reply, key) if key in reply.fields else None
