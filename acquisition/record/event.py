"""An event of a record: what happened, and at which moment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Event:
    """An event; `id` grows without end and is the version of the record."""

    id: int
    utc: float
    t_s: float | None
    kind: str
    data: Mapping[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """The event for JSON lines and server-sent events."""
        return {"id": self.id, "utc": self.utc, "t_s": self.t_s, "kind": self.kind, "data": dict(self.data)}


@dataclass(frozen=True)
class Moment:
    """Now: on the calendar (s since 1970) and in the campaign (s; None before its start)."""

    utc: float
    t_s: float | None = None
