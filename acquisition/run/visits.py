"""Visits of a plan that a person orders to be measured again, or left out.

The run may be active or paused. Readings that are replaced stay in the record, but are not used; new ones are planned
in their place. A visit that is left out is skipped with its reason. The sequencer asks the record for the next reading,
so both orders take effect from the next reading on.
"""

from __future__ import annotations

from collections.abc import Callable

from acquisition.record.store import PlannedReading, RecordStore
from acquisition.run.outcome import not_resumed

_OPEN, _DONE = ("planned", "deferred"), ("measured", "skipped")


class Visits:
    """The visits of a record that this program writes.

    Both methods return the number of affected readings.
    """

    def __init__(self, store: RecordStore) -> None:
        self._store = store

    def again(self, number: int, by: str, reason: str) -> int:
        """Plan the measured and skipped readings of a visit again.

        Raises
        ------
        NotResumed
            The run has ended.
        """
        return self._order("measure again", number, by, reason, _DONE, self._plan_again)

    def leave_out(self, number: int, by: str, reason: str) -> int:
        """Skip the readings of a visit that are not measured yet.

        Raises
        ------
        NotResumed
            The run has ended.
        """
        return self._order("leave out", number, by, reason, _OPEN, self._skip)

    def _order(
        self,
        verb: str,
        number: int,
        by: str,
        reason: str,
        statuses: tuple[str, ...],
        change: Callable[[list[PlannedReading], str], None],
    ) -> int:
        with self._store.changing():  # the rows that are checked are those that are changed
            if self._store.state.final:
                raise not_resumed(self._store.state, f"the campaign has {self._store.state.value}", verb)
            concerned = [
                each
                for each in self._store.plan()
                if each.visit.number == number and each.visit.counted and each.status in statuses
            ]
            if concerned:
                self._store.command(verb, by)
                change(concerned, reason or f"{verb}, by {by}")
            return len(concerned)

    def _plan_again(self, concerned: list[PlannedReading], reason: str) -> None:
        self._store.measure_again([each.id for each in concerned], reason)

    def _skip(self, concerned: list[PlannedReading], reason: str) -> None:
        for each in concerned:
            self._store.mark(each.id, "skipped", reason)
