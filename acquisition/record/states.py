"""The states of a campaign, their codes, and the table of allowed transitions."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

from acquisition.errors import IllegalTransition

LEFT_BEHIND = "The program ended in mid-campaign; nothing moves."
"""The reason of a pause that nobody ordered: killed, or the computer went off."""


class State(Enum):
    """The states of a run, as the record and the HTTP interface name them."""

    DRAFT = "draft"
    READY = "ready"
    RUNNING = "running"
    WAITING = "waiting_for_operator"
    PAUSED = "paused"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    STOPPED = "stopped"

    @property
    def code(self) -> int:
        """Number of the state, 0 to 7."""
        return list(State).index(self)

    @property
    def active(self) -> bool:
        """Whether devices are in use."""
        return self in (State.RUNNING, State.WAITING)

    @property
    def final(self) -> bool:
        """Whether no state follows.

        `stopped` is not final: a person may resume the campaign, because its record is complete.
        """
        return self in (State.SUCCEEDED, State.FAILED)


_S = State
TRANSITIONS: Mapping[State, frozenset[State]] = {
    _S.DRAFT: frozenset({_S.READY, _S.STOPPED}),
    _S.READY: frozenset({_S.RUNNING, _S.STOPPED}),
    _S.RUNNING: frozenset({_S.WAITING, _S.PAUSED, _S.SUCCEEDED, _S.FAILED, _S.STOPPED}),
    _S.WAITING: frozenset({_S.RUNNING, _S.PAUSED, _S.SUCCEEDED, _S.STOPPED}),
    _S.PAUSED: frozenset({_S.RUNNING, _S.SUCCEEDED, _S.STOPPED}),
    _S.STOPPED: frozenset({_S.RUNNING, _S.SUCCEEDED}),
    _S.SUCCEEDED: frozenset(),
    _S.FAILED: frozenset(),
}


def check_transition(old: State, new: State) -> None:
    """Check a change of state.

    Raises
    ------
    IllegalTransition
        The table does not allow it.
    """
    if new not in TRANSITIONS[old]:
        raise IllegalTransition(f"a campaign that is {old.value} cannot become {new.value}")
