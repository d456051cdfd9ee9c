"""Details that a bridge gives of its instrument beyond the common status: its clock (PING) and battery (STATUS)."""

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
    """The battery, where the bridge says it with its status. Raises LinkError."""
    return Details(battery_percent=_number_of(device, mbp.parse(status.raw), "batt"))


def clock_of(device: Bridged) -> float | None:
    """The instrument's own clock, s. Raises LinkError."""
    return _number_of(device, device.session.ask("PING", {}), "t")


def _number_of(device: Bridged, reply: mbp.Message, key: str) -> float | None:
    with device.session.understood():
        return mbp.number(reply, key) if key in reply.fields else None
