"""The two roles: a viewer reads, pauses and stops, an operator does everything.

The role is decided by method and path in one place. A new route therefore belongs to the operator until it is
listed here.

This module also has the settings that the service was started with.
"""

from __future__ import annotations

import hmac
import re
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Protocol

from acquisition import Cell
from service.http.access.connections import ConnectionLog
from service.http.wire.paths import PREFIX
from service.simulated_cell import SimulatedDevices

_READS = ("GET", "HEAD")
_COMES_TO_REST = re.compile(rf"{PREFIX}/(runs|loops|verifications)/[^/]+/(pause|stop)")


class Role(Enum):
    """The role of the token that a request came with."""

    VIEWER = "viewer"
    OPERATOR = "operator"


@dataclass(frozen=True)
class Tokens:
    """The tokens of one service."""

    operator: str = field(repr=False)
    viewer: str = field(repr=False)

    def role_of(self, token: str) -> Role | None:
        """Return the role of a token; None if it is unknown.

        Tokens are compared in constant time.
        """
        given = token.encode()
        operator = hmac.compare_digest(given, self.operator.encode())
        viewer = hmac.compare_digest(given, self.viewer.encode())
        if operator:
            return Role.OPERATOR
        return Role.VIEWER if viewer else None


def viewer_may(method: str, path: str) -> bool:
    """Return whether a request, or an operation of the description, is open to a viewer."""
    return method in _READS or (method == "POST" and _COMES_TO_REST.fullmatch(path) is not None)


class LivePublisher(Protocol):
    """A publisher of live values to other programs."""

    @property
    def log(self) -> ConnectionLog: ...

    def offer(self, topic: str, payload: bytes, *, retained: bool) -> None:
        """Take a value as JSON. It returns at once, and raises nothing.

        Parameters
        ----------
        topic : str
            Name of the value: `state`, `progress`, `prompt`, `reading`, `result` or `event`.
        retained : bool
            Whether the value holds until the next one; an event does not.
        """


UPLOAD_BYTES = 32 * 1024 * 1024  # 100,000 readings have some 20 MB


@dataclass(frozen=True)
class ServiceSettings:
    """The settings of a service.

    Attributes
    ----------
    record : Path
        Folder that holds everything.
    token_file : Path, optional
        File of the tokens.
    simulated : SimulatedDevices, optional
        Simulated devices; None for the real devices of `cell`.
    store : str, optional
        Address of the history; None for a file of the record.
    permitted_mm : float, optional
        Position error, RMS, from which dates of checks are calculated.
    publishers : tuple of LivePublisher
        Publishers of live values, already started.
    """

    record: Path
    tokens: Tokens
    token_file: Path | None = None
    cell: Cell | None = None
    simulated: SimulatedDevices | None = None
    host: str = "127.0.0.1"
    upload_bytes: int = UPLOAD_BYTES
    store: str | None = field(default=None, repr=False)
    permitted_mm: float | None = None
    publishers: tuple[LivePublisher, ...] = ()
