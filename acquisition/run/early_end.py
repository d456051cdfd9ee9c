"""Runs that a person ends early: they have succeeded with the readings that they have.

The order is durable before it is obeyed, so a program that is killed in between does not measure on when it is started
again. An order ends with the execution to which it was given: an error or a stop that comes first pauses or stops the
run as usual.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from acquisition.errors import NotResumed
from acquisition.record.states import State
from acquisition.record.store import COUNTED, RecordStore
from acquisition.run.outcome import verdict_of

NOT_AT_REST = "It was to be finished, but the robot was not seen at rest."
_ORDER, _END = "finish", "finished_early"
_OPEN_ORDER = f"""
SELECT utc, data FROM event WHERE kind = '{_ORDER}' AND id > (SELECT coalesce(max(id), 0) FROM event
WHERE kind = 'state' AND json_extract(data, '$.state') IN ('paused', 'stopped')) ORDER BY id LIMIT 1
"""
_FITTED = (
    f"SELECT count(*) FROM pose WHERE {COUNTED} AND replaced_by IS NULL AND status = 'measured' "
    "AND set_name <> 'reference'"
)


def note_order(store: RecordStore, by: str, reason: str, key: str | None) -> Mapping[str, Any] | None:
    """Note the order to finish and return it, as `open_order`; None if there is nothing left to do.

    That is so if the run has ended early already, or if the idempotency key was used before.

    Raises
    ------
    NotResumed
        The run has ended, or has no reading that could be fitted.
    """
    with store.changing() as db:  # the state that is checked is that of the order
        state = store.state
        if state.final:
            if early_end(store) is not None:
                return None
            raise NotResumed(
                f"the campaign has {state.value}: nothing is left to finish",
                command="finish",
                what_to_do="Export and diagnose its readings, or start a new record.",
            )
        if not store.database.query(_FITTED)[0][0]:
            raise NotResumed(
                "no pose is measured yet, so a campaign that ended now would have nothing to fit",
                command="finish",
                what_to_do="Wait for its first readings, or stop it.",
            )
        if state.active and (open_one := open_order(store)) is not None:
            return open_one
        if not store.command(_ORDER, by, key):
            return None
        store.note(db, _ORDER, by=by, reason=reason)
        return {"by": by, "reason": reason, "utc": store.moment().utc}


def open_order(store: RecordStore) -> Mapping[str, Any] | None:
    """Return `by`, `reason` and `utc` of the order that an active run has still to obey; None without one."""
    rows = store.database.query(_OPEN_ORDER)
    return json.loads(rows[0]["data"]) | {"utc": rows[0]["utc"]} if rows else None


def end_early(store: RecordStore, order: Mapping[str, Any]) -> str:
    """End a run whose devices are at rest; return the reason that its state has."""
    with store.changing() as db:
        store.close_attempts(db)  # of a move in which the run was paused
        _, why = verdict_of(store, ended_by=order["by"])
        store.note(db, _END, **as_ended(store, order))
        store.change_state(db, State.SUCCEEDED, why)
    return why


def as_ended(store: RecordStore, order: Mapping[str, Any]) -> dict[str, Any]:
    """Return `by`, `reason` and `utc` of an order, and `measured` of `total` readings with which it ends the run."""
    counts = store.counts()
    return {**order, "measured": counts.get("measured", 0), "total": sum(counts.values())}


def early_end(store: RecordStore) -> dict[str, Any] | None:
    """Return how a run was ended early, as `as_ended`; None if it was not."""
    return next(iter(store.data_of_events(_END)), None)
