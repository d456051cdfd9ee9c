"""Terminal output: progress on standard error, result tables on standard output.

On a terminal the progress is one spinner line with the current step; otherwise it is one plain line per step.
"""

from __future__ import annotations

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.status import Status
from rich.text import Text

PIPED_WIDTH = 120  # columns if the output is not a terminal


def _console(*, stderr: bool) -> Console:
    stream = sys.stderr if stderr else sys.stdout
    # No markup: labels and file names are shown as they are, brackets and all.
    return Console(
        stderr=stderr,
        markup=False,
        emoji=False,
        highlight=False,
        width=None if stream.isatty() else PIPED_WIDTH,
    )


def duration(seconds: float) -> str:
    """Format a duration: "42 s", "17 min", "3.4 h"."""
    for unit, length, most in (("s", 1.0, 100.0), ("min", 60.0, 100.0)):
        if seconds < most * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds / 3600.0:.1f} h"


class _Step:
    """Spinner text: the step, and the run time of the command whenever the line is drawn."""

    def __init__(self, step: str, begin: float) -> None:
        self._step, self._begin = step, begin

    def __rich__(self) -> Text:
        return Text(f"{self._step} ({duration(time.monotonic() - self._begin)})")


class Terminal:
    """Standard output and standard error of one command.

    Use it as a context manager; `say` is a progress callback. With `quiet` no tables are printed, because standard
    output belongs to a JSON document.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self.out = _console(stderr=False)
        self.out.quiet = quiet
        self._err = _console(stderr=True)
        self._status: Status | None = None
        self._begin = time.monotonic()

    def __enter__(self) -> Terminal:
        self.begin("starting")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.rest()

    @property
    def live(self) -> bool:
        """Whether progress is one line that changes, not one line per step."""
        return self._status is not None

    def begin(self, step: str) -> None:
        """Show the spinner if standard error is a terminal; also again after `rest`."""
        if self._err.is_terminal and self._status is None:
            self._status = self._err.status(_Step(step, self._begin))
            self._status.start()

    def say(self, step: str) -> None:
        """Show the step that has begun."""
        if self._status is not None:
            self._status.update(_Step(step, self._begin))
        else:
            self._err.print(f"truepose: {step}", soft_wrap=True)

    def rest(self) -> None:
        """Remove the spinner before results or a question."""
        if self._status is not None:
            self._status.stop()
            self._status = None

    def note(self, text: str) -> None:
        """Print one line for people on standard error."""
        self._err.print(text, soft_wrap=True)
