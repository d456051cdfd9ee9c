"""Terminal display of a campaign: progress, remaining time and prompts."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from acquisition import Event, Run, RunStatus
from acquisition.run import PROMPT
from calib.units import percent
from drivers.operator import TerminalOperator
from service.printed.terminal import Terminal, duration
from service.wording import VERDICT_NAMES, counted

LINES = 20  # of progress in a log, where a line per reading would be too many
_SENTENCES = {
    "warm_up": "warming up",
    "warming_up": "warming up: measuring the reference pose again",
    "warm": "the arm is warm",
    "nests_checked": "the nests were checked",
    "nests_judged": "somebody judged what was measured before a nest moved",
    "restation": "the instrument is moved: its nests come before the next pose",
    "reconnect": "connection lost, connecting again",
    "nests_again": "measuring the nests again",
    "second_stage": "stage 1 is calibrated (stage1.json in the record): what was out of stroke comes again",
    "instrument_moved": "the instrument has moved: the nests give its new place",
}


class RunProgress:
    """Listener that shows the events of a run. `prompt` is the text of the last prompt, or None."""

    def __init__(self, run: Run, terminal: Terminal) -> None:
        self._run, self._terminal = run, terminal
        self._step_shown = -1
        self._pictured = self._on_path = False
        self._can_stop = True
        self.prompt: str | None = None

    def __call__(self, event: Event) -> None:
        if event.kind == "prompt":
            self.prompt = event.data["text"]
            self._terminal.rest()  # the spinner would write over the question
            if not self._pictured and (self._run.folder / PROMPT).is_file():
                self._pictured = True
                self._terminal.note(f"A picture of what is asked: {self._run.folder / PROMPT}")
        elif event.kind == "answer":
            self._terminal.begin("measuring")
        elif event.kind == "connected":
            if not event.data["can_stop"] and event.data["role"] == "robot":
                self._can_stop = False
                self._terminal.note(
                    "This robot cannot be stopped by the program: keep a hand on its emergency stop."
                )
            if event.data["weakness"]:
                self._terminal.note(f"The {event.data['role']} is not protected: {event.data['weakness']}.")
        elif event.kind == "battery_low":
            self._terminal.note(
                f"The battery of the ballbar has {percent(event.data['percent'] / 100.0)}: change it soon."
            )
        elif event.kind == "taught":
            self._terminal.say(_taught(event.data))
        elif event.kind == "nest_doubted":
            self._terminal.note(event.data["text"])
        elif event.kind == "command" and event.data["verb"] == "pause":
            after = "move in hand; the path begins anew then" if self._on_path else "reading in hand"
            once_more = (
                "stops the robot now" if self._can_stop else "ends the campaign, but cannot stop this robot"
            )
            self._terminal.note(f"Pausing after the {after}. Ctrl-C once more {once_more}.")
        elif event.kind == "reading" and event.data["set"] == "nest":
            self._terminal.say(f"nest {event.data['target']} measured")
        elif event.kind == "waypoint":
            self._on_path = event.data["waypoint"] < event.data["of"]
            self._show_path(event.data)
        elif event.kind in ("reading", "skipped"):
            self._show(self._run.status())
        elif event.kind == "accuracy":
            self._terminal.say(_accuracy(event.data))
        elif event.kind in _SENTENCES:
            self._terminal.say(_SENTENCES[event.kind])

    def _show(self, status: RunStatus) -> None:
        step = status.done * LINES // max(status.total, 1)
        if self._terminal.live or step != self._step_shown:
            self._step_shown = step
            drift = "" if status.drift is None else f", drift {status.drift['off_mm']:.3f} mm"
            done = f"{status.done} of {counted(status.total, 'reading')}"
            self._terminal.say(f"{done}{_left(status.seconds_left)}{drift}")

    def _show_path(self, path: Mapping[str, Any]) -> None:
        lost = path["lost"]
        samples = ", ".join(
            f"{role} {count:,}" + (f" ({lost[role]:,} lost)" if lost[role] else "")
            for role, count in path["samples"].items()
        )
        left = _left(self._run.status().seconds_left)
        self._terminal.say(f"waypoint {path['waypoint']} of {path['of']}, samples: {samples}{left}")


def _taught(data: Mapping[str, Any]) -> str:
    """Describe the changes after the cups were touched, in one line."""
    left_out = f", {data['refused']} are not reached from there" if data["refused"] else ""
    return (
        f"the cups were touched up to {data['off_mm']:.2f} mm from where the cell file has them; "
        f"{data['poses']} poses planned anew{left_out}"
    )


def _accuracy(data: Mapping[str, Any]) -> str:
    """Describe what the poses so far promise, in one line."""
    poses = counted(data["poses"], "pose")
    if data["ended"]:
        return data["ended"]
    if data["bound_mm"] is None:
        return f"{poses}: too few to tell the accuracy"
    left = "" if data["poses_left"] is None else f", about {data['poses_left']} more to go"
    verdict = VERDICT_NAMES[data["verdict"]].lower()
    return (
        f"{poses}: RMS error below {data['bound_mm']:.3f} mm (95 %), {data['deciding_mm']:.3f} mm where every look "
        f"counts, required: {data['wanted_mm']:g} mm; diagnosis so far: {verdict}{left}"
    )


def _left(seconds: float | None) -> str:
    return "" if seconds is None else f", {duration(seconds)} left"


@contextmanager
def terminal_operator() -> Iterator[TerminalOperator]:
    """Yield the person at this terminal as operator; without one, asking raises `NoOperator`.

    It reads through a separate file object. A thread that still waits for a line when the program ends would otherwise
    hold the lock of `sys.stdin`, which makes the interpreter abort while it shuts down.
    """
    if sys.stdin is None or sys.stdin.closed or not sys.stdin.isatty():
        yield TerminalOperator()
        return
    yield TerminalOperator(reader=os.fdopen(os.dup(sys.stdin.fileno()), encoding="utf-8", errors="replace"))
