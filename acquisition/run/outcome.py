"""The results of an execution of a campaign, and the reasons why none may begin."""

from __future__ import annotations

from dataclasses import dataclass

from acquisition.errors import NotResumed
from acquisition.record.states import State
from acquisition.record.store import RecordStore
from drivers.errors import AcquisitionError


@dataclass(frozen=True)
class ExecutionOutcome:
    """The result of an execution.

    `error` is None if the run finished, or ended on request.
    """

    state: State
    reason: str
    error: AcquisitionError | None = None

    @property
    def exit_code(self) -> int:
        """Exit code of the command line.

        It is 0 if done, that of the error, 130 if paused or stopped by a person, 1 if failed.
        """
        if self.error is not None:
            return self.error.exit_code
        return {State.SUCCEEDED: 0, State.PAUSED: 130, State.STOPPED: 130}.get(self.state, 1)


def verdict_of(store: RecordStore, ended_by: str = "") -> tuple[State, str]:
    """Return the final state of a campaign, and the reason to show.

    It has no open readings, or was ended early by a person.
    """
    counts = store.counts()
    if not counts.get("measured"):
        return State.FAILED, "Not one pose could be measured."
    remarks = []
    measured = counts["measured"]
    if ended_by:
        remarks.append(
            f"Finished early by {ended_by}: {measured} of {sum(counts.values())} readings were measured."
        )
    if (skipped := counts.get("skipped", 0)) > measured:
        remarks.append(f"Most is missing: {measured} of {measured + skipped} readings were measured.")
    elif skipped:
        remarks.append(f"{skipped} reading{' was' if skipped == 1 else 's were'} skipped.")
    if (stations := store.campaign["station"]) > 1:
        remarks.append(f"The instrument was moved: its readings come from {stations} stations.")
    return State.SUCCEEDED, " ".join(remarks)


def not_resumed(state: State, message: str, command: str) -> NotResumed:
    """Return the error for `command` in this state.

    `message` is used if the state has no special text for it.
    """
    if state is State.SUCCEEDED:
        return NotResumed(
            "the campaign is finished; nothing to resume",
            command=command,
            what_to_do="Export its readings, or start a new record to measure again.",
        )
    return NotResumed(message, command=command)
