"""The record: states, append-only attempts, one good reading per pose, one owner.

The state that a crash leaves behind is tested too.
"""

from __future__ import annotations

import itertools
import json
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition import State
from acquisition.campaign import make_plan
from acquisition.cell.world_frame import WorldFrame
from acquisition.errors import IllegalTransition, StorageError
from acquisition.record import FILE, RecordStore
from acquisition.record.attempts import Attempts
from acquisition.record.states import TRANSITIONS, check_transition
from acquisition.record.store import PlannedReading
from acquisition.run.status import status_of
from drivers import JointReading, LinkLost, PointReading, Prompt
from tests.acquisition.fakes import a_campaign, a_cell, new_store
from tests.drivers.waiting import PATIENCE_S, in_thread

READING = PointReading("T1", (1.0, 2.0, 3.0), (0.1, 0.1, 0.1), 10, 5.0, 0.0, 22.5, raw=b"\x00raw")


def half_a_change(store: RecordStore) -> None:
    with store.changing() as db:
        store.add_event("never")
        store.change_state(db, State.SUCCEEDED, "")


def fill(store: RecordStore) -> Iterator[int]:
    """Events until the disk is full."""
    for number in itertools.count(1):
        store.add_event("filler", text="x" * 500)
        yield number


def poses(store: RecordStore) -> list[PlannedReading]:
    return [planned for planned in store.plan() if planned.visit.kind == "pose"]


def test_codes_are_the_contracts() -> None:
    named = ["draft", "ready", "running", "waiting_for_operator", "paused", "succeeded", "failed", "stopped"]
    assert [(state.value, state.code) for state in State] == [(name, i) for i, name in enumerate(named)]


@given(st.sampled_from(list(State)), st.sampled_from(list(State)))
@settings(max_examples=200)
def test_only_the_table_allows(old: State, new: State) -> None:
    if new in TRANSITIONS[old]:
        check_transition(old, new)
    else:
        with pytest.raises(IllegalTransition, match=f"{old.value} cannot become {new.value}"):
            check_transition(old, new)
    assert not (old.final and TRANSITIONS[old])
    assert not old.active or State.PAUSED in TRANSITIONS[old]  # whatever happens, it can come to rest


WORLD = WorldFrame(np.eye(3), np.array([3.0, 3.0, 3.0]))  # what is at (1, 2, 3) is at (4, 5, 6)


def test_plan_comes_back_as_it_was_planned(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    visits = make_plan(a_cell(), a_campaign())
    assert list(dict.fromkeys(planned.visit for planned in store.plan())) == visits
    assert [p.target for p in store.plan()] == [t for visit in visits for t in visit.targets]
    assert store.state is State.READY
    store.close()


def test_reading_needs_its_own_arrival_and_is_kept_once(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    store.start()
    attempts = Attempts(store)
    first, second, other = poses(store)[0], poses(store)[1], poses(store)[2]
    assert first.visit.number == second.visit.number != other.visit.number
    for arrival in (None, attempts.begin_arrival(first.visit)):  # none, and one that is not over
        with pytest.raises(StorageError, match="needs its approach"):
            attempts.begin_reading(first, arrival)
    arrival = attempts.begin_arrival(first.visit)
    attempts.arrived(arrival, JointReading((1.0,) * 6, 1e-5, b"read"))
    with pytest.raises(StorageError, match="needs its approach"):
        attempts.begin_reading(other, arrival)
    one, two = attempts.begin_reading(first, arrival), attempts.begin_reading(first, arrival)
    attempts.measured(one, first, READING, WORLD)
    with pytest.raises(StorageError, match="UNIQUE"):
        attempts.measured(two, first, READING, WORLD)
    attempts.failed(two, LinkLost("gone", raw=b"half"))
    for late in (
        lambda: attempts.failed(one, LinkLost("late")),
        lambda: attempts.measured(two, first, READING, None),
    ):
        with pytest.raises(StorageError, match="closed attempt"):
            late()
    store.close()
    with sqlite3.connect(tmp_path / FILE) as db:
        row = db.execute(
            "SELECT raw, tracker_x_mm, world_z_mm, t_air_c FROM attempt WHERE id = ?", (one,)
        ).fetchone()
        assert row == (b"\x00raw", 1.0, 6.0, 22.5)
        assert db.execute("SELECT raw, error_code FROM attempt WHERE id = ?", (two,)).fetchone() == (
            b"half",
            1002,
        )
        for statement in ("DELETE FROM attempt", "DELETE FROM event", "UPDATE event SET kind = 'x'"):
            with pytest.raises(sqlite3.IntegrityError):
                db.execute(statement)
    db.close()


@pytest.mark.parametrize(
    ("statement", "why"),
    [
        ("UPDATE campaign SET campaign = ''", "a campaign that was begun never changes"),
        ("UPDATE campaign SET cell = ''", "a campaign that was begun never changes"),
        ("UPDATE pose SET joints_deg = '[]'", "a planned reading never changes"),
        ("DELETE FROM pose", "a planned reading is never deleted"),
        ("UPDATE pose SET status = 'measured'", "only a good reading"),
        ("DELETE FROM command", "a command is never deleted"),
        ("UPDATE command SET by = 'nobody'", "a command never changes"),
        ("DELETE FROM prompt", "a prompt is never deleted"),
        ("UPDATE prompt SET answer = 'skip'", "an answer never changes"),
        (
            "INSERT INTO attempt (kind, visit, began_utc, began_t_s) VALUES ('arrive', 3, 0, 0)",
            "unless the camp",
        ),
    ],
)
def test_what_was_planned_asked_and_told_is_never_rewritten(tmp_path: Path, statement: str, why: str) -> None:
    store = new_store(tmp_path)
    store.start()
    store.command("pause", "anna")
    attempts = Attempts(store)
    attempts.ask(Prompt("p", "well?"))
    attempts.answered("p", "confirm", "anna")
    store.become(State.PAUSED)
    store.close()
    with closing(sqlite3.connect(tmp_path / FILE)) as db, pytest.raises(sqlite3.IntegrityError, match=why):
        db.execute(statement)


def test_nothing_is_attempted_before_the_prompt_is_answered(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    store.start()
    with store.changing() as db:
        db.execute("INSERT INTO prompt (id, text, expects, asked_utc) VALUES ('p', 'well?', '[]', 0)")
    attempts, visit = Attempts(store), poses(store)[0].visit
    with pytest.raises(StorageError, match="before the prompt is answered"):
        attempts.begin_arrival(visit)
    attempts.answered("p", "void", "program")
    attempts.begin_arrival(visit)
    store.close()


def test_a_reading_relies_on_the_last_arrival(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    store.start()
    attempts, planned = Attempts(store), poses(store)[0]
    arrivals = []
    for _ in range(2):
        arrivals.append(attempts.begin_arrival(planned.visit))
        attempts.arrived(arrivals[-1], JointReading((1.0,) * 6, 1e-5))
    with pytest.raises(StorageError, match="elsewhere since"):
        attempts.begin_reading(planned, arrivals[0])
    attempts.begin_reading(planned, arrivals[1])
    store.close()


def test_a_reading_that_is_not_trusted_is_planned_once_more(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    store.start()
    attempts, planned = Attempts(store), poses(store)[0]
    arrival = attempts.begin_arrival(planned.visit)
    attempts.arrived(arrival, JointReading((1.0,) * 6, 1e-5))
    attempts.measured(attempts.begin_reading(planned, arrival), planned, READING, None)
    assert [each.target for each in store.left("planned")] == ["T2"]
    store.measure_again([planned.id], "bumped")
    assert [each.target for each in store.left("planned")] == ["T2", "T1"]
    assert store.counts() == {"planned": 5}
    again = store.left("planned")[1]
    assert (again.visit.joints_deg, again.visit.number) == (planned.visit.joints_deg, planned.visit.number)
    with pytest.raises(StorageError, match="replaced once"):
        store.measure_again([planned.id], "twice")
    store.close()


def test_changes_within_a_change_are_one(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    heard: list[str] = []
    with store.listening(lambda event: heard.append(event.kind)):
        with store.changing():
            store.add_event("first")
            store.add_event("second")
            assert heard == []  # not durable yet
        assert heard == ["first", "second"]
        with pytest.raises(IllegalTransition):
            half_a_change(store)
        store.add_event("fourth")
    assert heard == ["first", "second", "fourth"]  # nothing of the half
    assert [event.kind for event in store.events()][-3:] == heard
    store.close()


def test_events_reach_listeners_after_they_are_durable(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    seen: list[tuple[int, int]] = []

    def look(event: object) -> None:
        reader = RecordStore.open(tmp_path, writer=False)
        seen.append((event.id, reader.version))  # type: ignore[attr-defined]
        reader.close()

    with store.listening(look):
        store.add_event("hello", what=1)
        with pytest.raises(IllegalTransition):
            half_a_change(store)
    assert len(seen) == 1
    assert seen[0][0] == seen[0][1] == store.version
    assert store.events(seen[0][0] - 1)[0].data == {"what": 1}
    store.close()


def test_recovery_marks_what_was_open(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    attempts = Attempts(store)
    store.start()
    arrival = attempts.begin_arrival(poses(store)[0].visit)
    store.close()
    store = RecordStore.open(tmp_path)
    assert store.state is State.RUNNING
    store.recover()
    assert store.state is State.PAUSED
    died = [event for event in store.events() if event.kind == "attempt_died"]
    assert [event.data["attempt"] for event in died] == [arrival]
    assert [row[0] for row in store.database.query("SELECT status FROM attempt")] == ["died"]
    version = store.version
    store.recover()
    assert store.version == version
    store.close()


def test_a_full_disk_loses_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    """`max_page_count` stands for the end of the disk: SQLite answers the same 'disk is full'."""
    store = new_store(tmp_path)
    count = store.database.query("PRAGMA page_count")[0][0]
    store.database.script(f"PRAGMA max_page_count = {count}")
    ids: list[int] = []
    with pytest.raises(StorageError, match="full"):
        ids.extend(fill(store))
    fillers = [event for event in store.events(limit=20_000) if event.kind == "filler"]
    assert len(fillers) == len(ids) > 0
    store.database.script(f"PRAGMA max_page_count = {count * 100}")
    store.add_event("filler", text="again")
    assert store.database.query("PRAGMA integrity_check")[0][0] == "ok"
    store.close()


def test_a_look_does_not_wait_for_a_change_that_is_being_written(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    before = store.version
    with store.changing() as db:
        store.note(db, "news")
        assert in_thread(lambda: (store.version, status_of(store).version)).result(PATIENCE_S) == (
            before,
            before,
        )
        assert store.version == before + 1  # in its own thread
    assert store.version == before + 1
    store.close()


def test_idempotency_key_counts_once(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    assert [store.command("pause", "anna", key) for key in ("k", "k", None, None)] == [
        True,
        False,
        True,
        True,
    ]
    store.close()


def test_wait_beyond_a_version(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    version = store.version
    assert store.wait_beyond(version, 0.0) == version
    writer = threading.Thread(target=lambda: store.add_event("news"))
    writer.start()
    assert store.wait_beyond(version, PATIENCE_S) == version + 1
    writer.join()
    assert json.dumps(status_of(store).as_dict())
    store.close()
