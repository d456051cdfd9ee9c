"""Outcomes of an execution of a campaign, and why none may begin."""

from __future__ import annotations

from dataclasses import dataclass

from acquisition.errors import NotResumed
from acquisition.record.states import State
from acquisition.record.store import RecordStore
from drivers.errors import AcquisitionError


@dataclass(frozen=True)
class ExecutionOutcome:
    """The outcome of an execution. `error` None: done, or as somebody asked."""

    state: State
    reason: str
    error: AcquisitionError | None = None

    @property
    def exit_code(self) -> int:
        """The exit code of the command line: 0 done, the error's own, 130 paused or stopped by a person, 1 failed."""
        if self.error is not None:
            return self.error.exit_code
        return {State.SUCCEEDED: 0, State.PAUSED: 130, State.STOPPED: 130}.get(self.state, 1)


def verdict_of(store: RecordStore) -> tuple[State, str]:
    """The state in which a campaign ends of which nothing is left, and the reason that is shown with it."""
    counts = store.counts()
    if not counts.get("measured"):
        return State.FAILED, "Not one pose could be measured."
    remarks = []
    measured = counts["measured"]
    if (skipped := counts.get("skipped", 0)) > measured:
        remarks.append(f"Most is missing: {measured} of {measured + skipped} readings were measured.")
    elif skipped:
        remarks.append(f"{skipped} reading{' was' if skipped == 1 else 's were'} skipped.")
    if (stations := store.campaign["station"]) > 1:
        remarks.append(f"The instrument was moved: its readings come from {stations} stations.")
    return State.SUCCEEDED, " ".join(remarks)


def not_resumed(state: State, message: str, command: str) -> NotResumed:
    """The refusal of `command` in this state; `message` where the state has no words of its own for it."""
    if state is State.SUCCEEDED:
        return NotResumed(
            "the campaign is finished; nothing to resume",
            command=command,
            what_to_do="Export its readings, or start a new record to measure again.",
        )
    return NotResumed(message, command=command)
