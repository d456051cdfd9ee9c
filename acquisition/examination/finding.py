"""The findings of an examination: one per check, with its observation and its remedy.

ok     as it should be
note   a campaign can run, but a person should know
fault  a campaign would be refused or could not be trusted; `code` and `error` are those of `drivers.errors`
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeVar

from acquisition.errors import StorageError
from drivers.errors import AcquisitionError, ConfigError, LinkError, SafetyStop

Level = Literal["ok", "note", "fault"]
Listener = Callable[[str], None]
_T = TypeVar("_T")

HEALTHY, FAILED, WRONG_CELL, NOT_AVAILABLE, UNSAFE = 0, 1, 2, 4, 5
_WORST_FIRST = (UNSAFE, WRONG_CELL, NOT_AVAILABLE, FAILED)


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of one check.

    `device` is robot, instrument or computer; `check` is a stable name within the device.
    """

    device: str
    check: str
    level: Level
    found: str
    do: str = ""
    code: int | None = None
    error: str | None = None
    exit_code: int = HEALTHY


class Chart:
    """The findings of one device, in order.

    Attributes
    ----------
    again
        Returns whether the device can be queried further after a link broke; False until it is set.
    """

    def __init__(self, device: str, progress: Listener) -> None:
        self.device = device
        self.findings: list[CheckResult] = []
        self.again: Callable[[], bool] = lambda: False
        self._progress = progress

    def begin(self, check: str) -> None:
        """Report which question a device is asked now, for people who wait."""
        self._progress(f"{self.device}: {check}")

    def ok(self, check: str, found: str) -> None:
        self.findings.append(CheckResult(self.device, check, "ok", found))

    def note(self, check: str, found: str, do: str = "") -> None:
        self.findings.append(CheckResult(self.device, check, "note", found, do))

    def fault(self, check: str, error: AcquisitionError) -> None:
        self.findings.append(
            CheckResult(
                self.device,
                check,
                "fault",
                error.message,
                error.what_to_do,
                error.code,
                type(error).__name__,
                exit_code_of(error),
            )
        )

    def ask(self, check: str, question: Callable[[], _T]) -> _T | None:
        """Return the answer of a question, or None after recording why there is none.

        Raises
        ------
        LinkError
            The link broke and the device cannot be queried further; the error is recorded as well.
        """
        self.begin(check)
        try:
            return question()
        except LinkError as error:
            self.fault(check, error)
            if not self.again():
                raise
            return None
        except AcquisitionError as error:
            self.fault(check, error)
            return None


def exit_code_of(error: AcquisitionError) -> int:
    """Return the exit code of the command line for the family of the error."""
    if isinstance(error, SafetyStop):
        return UNSAFE
    if isinstance(error, ConfigError):
        return WRONG_CELL
    return FAILED if isinstance(error, StorageError) else NOT_AVAILABLE


@dataclass(frozen=True)
class Examination:
    """All findings of one cell."""

    cell: str
    simulated: bool
    seconds: float
    findings: Sequence[CheckResult] = field(default_factory=list)

    @property
    def faults(self) -> list[CheckResult]:
        """The faults: findings that prevent a campaign."""
        return [finding for finding in self.findings if finding.level == "fault"]

    @property
    def notes(self) -> list[CheckResult]:
        """The notes: observations that a person should know."""
        return [finding for finding in self.findings if finding.level == "note"]

    @property
    def exit_code(self) -> int:
        """Exit code of the worst fault; 0 without faults.

        An unsafe cell comes before a wrong cell file, then a missing device, then a full disk.
        """
        found = {fault.exit_code for fault in self.faults}
        return next((code for code in _WORST_FIRST if code in found), HEALTHY)
