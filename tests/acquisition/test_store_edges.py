"""Edge cases of the record: its owner, waking of waiters, notes with actions, replacement.

Each of these tests was required by a small change of `acquisition/record/store.py` that no test had noticed
(tests/sabotage/mutants.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from acquisition import State
from acquisition.errors import RecordTaken, StorageError
from acquisition.record import RecordStore, seal
from acquisition.record.attempts import Attempts
from drivers import Prompt
from tests.acquisition.fakes import new_store
from tests.acquisition.test_store import WORLD, poses
from tests.drivers.waiting import PATIENCE_S, in_thread, until


@pytest.fixture
def store(tmp_path: Path) -> Iterator[RecordStore]:
    store = new_store(tmp_path)
    yield store
    store.close()


def last(store: RecordStore) -> tuple[str, dict]:
    """Kind and data of the event noted last."""
    event = store.events()[-1]
    return event.kind, dict(event.data)


def test_a_record_that_another_program_took_over_is_not_written(store: RecordStore) -> None:
    """The other program may bypass the lock, or the locks of a network drive may not work."""
    store.add_event("mine")
    with store.database.transaction() as db:
        db.execute("UPDATE campaign SET owner = 'somebody else'")
    with pytest.raises(RecordTaken, match="another program writes this record now"):
        store.add_event("lost")
    assert last(store)[0] == "mine"


def test_whoever_waits_is_woken_by_a_change(store: RecordStore) -> None:
    """Not only at the end of the time for which it would wait."""
    version = store.version
    waiting = in_thread(lambda: store.wait_beyond(version, 10 * PATIENCE_S))
    until(lambda: bool(store._changed._waiters))  # type: ignore[attr-defined]
    store.add_event("news")
    assert waiting.result(PATIENCE_S) == version + 1


def test_a_record_that_was_looked_at_can_be_moved(tmp_path: Path) -> None:
    new_store(tmp_path).close()
    with RecordStore.reading(tmp_path) as looked:
        assert looked.state is State.READY
    with pytest.raises(StorageError, match="closed database"):
        looked.database.query("SELECT 1")


def test_what_is_done_is_noted(store: RecordStore) -> None:
    first, second = poses(store)[:2]
    store.command("pause", "anna")
    assert last(store) == ("command", {"verb": "pause", "by": "anna"})
    store.mark(first.id, "skipped", "in the way")
    assert last(store) == ("skipped", {"pose": first.id, "reason": "in the way"})
    store.measure_again([second.id], "the world moved")
    kind, data = last(store)
    assert (kind, data["poses"], data["reason"]) == ("measure_again", [second.id], "the world moved")
    [again] = data["replaced_by"]
    assert again in {each.id for each in store.plan()}
    assert second.id not in {each.id for each in store.plan()}
    before = store.version
    store.measure_again([], "nothing")
    assert store.version == before


def test_a_visit_that_is_planned_elsewhere_is_sealed_and_replaces_the_one(store: RecordStore) -> None:
    visit = poses(store)[0].visit
    old = [each for each in store.plan() if each.visit == visit]
    elsewhere = replace(visit, name="elsewhere", joints_deg=tuple(q + 1.0 for q in visit.joints_deg))
    store.replan(old, elsewhere)
    left = store.plan()
    made = [each for each in left if each.visit.name == "elsewhere"]
    assert [(each.target, each.base_target) for each in made] == [
        (each.target, each.base_target) for each in old
    ]
    assert not {each.id for each in old} & {each.id for each in left}
    assert last(store)[1]["poses"] == [each.id for each in old]
    seal.check(store.database)


def test_a_question_that_a_crash_left_open_is_void(store: RecordStore, tmp_path: Path) -> None:
    store.start()
    Attempts(store).ask(Prompt("seat", "Seat the SMR."))
    store.close()
    store = RecordStore.open(tmp_path)
    store.recover()
    assert [row[0] for row in store.database.query("SELECT answer FROM prompt")] == ["void"]
    store.close()


def test_nests_of_the_world_frame(store: RecordStore) -> None:
    assert store.world_nests_mm is None
    store.set_world(WORLD, {"N1": (1.0, 2.0, 3.0)}, new_station=False)
    assert store.world_nests_mm == {"N1": (1.0, 2.0, 3.0)}
