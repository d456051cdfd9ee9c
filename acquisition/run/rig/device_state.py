"""What is known of the devices of a cell: their last act, answer or error.

Nothing is asked for it. It says what a run or an examination has met, and what has become of that since. Trouble that
was met last stays known after the connection is given up, until the device is asked again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum

from acquisition.errors import StorageError
from drivers.errors import AcquisitionError, BeamBroken, LeftOut, LinkError, TargetNotSeen, Unmeasurable

ROLES = ("robot", "instrument")


class DeviceCondition(Enum):
    """The conditions of a device, as record and interface name them."""

    UNKNOWN = "unknown"
    NOT_CONNECTED = "not_connected"
    CONNECTING = "connecting"
    READY = "ready"
    MOVING = "moving"
    MEASURING = "measuring"
    BEAM_LOST = "beam_lost"
    SILENT = "silent"
    IN_ERROR = "in_error"

    @property
    def trouble(self) -> bool:
        """Whether a person has to look at the device."""
        return self in (DeviceCondition.BEAM_LOST, DeviceCondition.SILENT, DeviceCondition.IN_ERROR)


@dataclass(frozen=True)
class KnownDevice:
    """What is known of a device.

    Attributes
    ----------
    says
        One or two sentences for a person; with trouble also what to do.
    since_utc
        Time of the last change, s since 1970; None if nothing is known.
    heard_utc
        Time of the last answer, s since 1970; None if there was none.
    code
        Code of the error (`drivers.errors`).
    """

    role: str
    condition: DeviceCondition
    says: str
    since_utc: float | None = None
    heard_utc: float | None = None
    code: int | None = None


NEVER_ASKED = {
    role: KnownDevice(
        role,
        DeviceCondition.UNKNOWN,
        "Nothing has asked it since the service was started.",
    )
    for role in ROLES
}


class DeviceStates:
    """What one execution knows of its devices. Any thread may look at `known`.

    Parameters
    ----------
    utc
        Returns the calendar time, s since 1970.
    changed
        Called when trouble begins, changes or ends; not at every act.
    """

    def __init__(self, utc: Callable[[], float], changed: Callable[[KnownDevice], None]) -> None:
        self._utc, self._changed = utc, changed
        self._told: dict[str, DeviceCondition | None] = {}  # the trouble that was reported last
        self.known: Mapping[str, KnownDevice] = {}  # replaced as a whole

    def heard(self, role: str) -> None:
        """Note that a device has answered."""
        if (before := self.known.get(role)) is not None:
            self.known = {**self.known, role: replace(before, heard_utc=self._utc())}

    def note(self, role: str, condition: DeviceCondition, says: str, code: int | None = None) -> None:
        """Note what a device does, or what is wrong with it."""
        now_utc, before = self._utc(), self.known.get(role)
        if condition is DeviceCondition.CONNECTING and before and before.condition is DeviceCondition.SILENT:
            return  # lost until it answers
        silent = condition in (
            DeviceCondition.CONNECTING,
            DeviceCondition.SILENT,
            DeviceCondition.NOT_CONNECTED,
        )
        heard_utc = (before and before.heard_utc) if silent else now_utc
        since_utc = before.since_utc if before and before.condition is condition else now_utc
        now = KnownDevice(role, condition, says, since_utc, heard_utc, code)
        self.known = {**self.known, role: now}
        trouble = condition if condition.trouble else None
        if condition is not DeviceCondition.CONNECTING and trouble is not self._told.get(role):
            self._told[role] = trouble
            self._changed(now)

    def failed(self, role: str, error: AcquisitionError, *, stopped: bool) -> None:
        """Note an error of a device; `stopped` if a person has stopped it."""
        if isinstance(error, StorageError):  # of the record
            return
        if stopped or isinstance(error, LeftOut):
            self.note(role, DeviceCondition.READY, error.what_happened)
        elif isinstance(error, LinkError):
            self.note(role, DeviceCondition.SILENT, error.sentence, error.code)
        elif isinstance(error, BeamBroken | TargetNotSeen):
            self.note(role, DeviceCondition.BEAM_LOST, error.sentence, error.code)
        elif isinstance(error, Unmeasurable):
            self.note(role, DeviceCondition.READY, error.what_happened, error.code)
        else:
            self.note(role, DeviceCondition.IN_ERROR, error.sentence, error.code)

    def released(self) -> None:
        """Note that the connections are given up."""
        for role, each in self.known.items():
            if not each.condition.trouble:
                self.note(
                    role, DeviceCondition.NOT_CONNECTED, "It was released; nothing is connected to it now."
                )
