"""Random events at any device call, in any order.

No reading is lost, none is doubled, and none is taken without its approach. Hypothesis plays operator, faults and power
cut. A crash closes the record's connection in the middle of any action, as the end of the process would; the fakes
remember the truth.
`TRUEPOSE_MACHINE_EXAMPLES` sets how many campaigns (40; 100 in `make long`).
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from acquisition.errors import NotResumed
from acquisition.record.database import FILE
from acquisition.record.store import Event
from acquisition.run.run import Run
from drivers.errors import (
    BeamBroken,
    EmergencyStop,
    LinkLost,
    LinkTimeout,
    NoOperator,
    OutOfRange,
    WrongMode,
)
from drivers.interfaces import Answer, Prompt
from tests.acquisition.fakes import (
    BALLBAR,
    HEXAPOD,
    Bench,
    Crash,
    JumpingClock,
    SeatingOperator,
    a_campaign,
    a_cell,
    devices_of,
)
from tests.acquisition.stage import fill_disk

BLOCKS = [{"set": "calibration", "count": 2, "targets": ["T1", "T2"]}, {"set": "validation", "count": 1}]
SETUPS: dict[str, tuple[dict[str, Any], list[dict[str, Any]], int]] = {
    "SMRs": ({}, BLOCKS, 2 * 2 + 3),
    "one SMR": ({"instrument__one_smr": True}, BLOCKS, 2 * 2 + 3),
    "ballbar": (BALLBAR, HEXAPOD, 2 * 6),
}
MEMORY = Path("/dev/shm")  # no power is cut here, so the disk need not be waited for
ERRORS: dict[str, BaseException] = {
    "link": LinkLost("lost"),
    "silence": LinkTimeout("late"),
    "beam": BeamBroken("broken"),
    "stroke": OutOfRange("beyond"),
    "manual": WrongMode("manual"),
    "estop": EmergencyStop("pressed"),
    "nobody": NoOperator("gone"),
    "bug": ZeroDivisionError(),
}
ORDERS = ("crash", "pause", "stop", "stop then crash", "clock", "full disk", "browser", "tracker moved")
HAPPENINGS = (*ERRORS, *ORDERS)
ANSWERS = (*Answer, "pause", "stop", "crash", "nobody")


class Person(SeatingOperator):
    """Operator who may act before the answer is given.

    The desk decides whether the answer still counts then.
    """

    def __init__(self, bench: Bench, answers: list[Answer | str], do: Callable[[str], None]) -> None:
        super().__init__(bench)
        self.mixed, self.do = list(answers), do

    def ask(self, prompt: Prompt) -> Answer:
        given = self.mixed.pop(0) if self.mixed else Answer.CONFIRM
        self.answers = [given] if isinstance(given, Answer) else []
        answer = super().ask(prompt)
        if isinstance(given, str):
            self.do(given)  # last: the campaign may be over when this thread goes on
        return answer


class CampaignMachine(RuleBasedStateMachine):
    """One record, executed again and again."""

    folder: Path
    bench: Bench
    run: Run

    @initialize(setup=st.sampled_from(sorted(SETUPS)))
    def begin(self, setup: str) -> None:
        self.setup, (cell, blocks, self.readings) = setup, SETUPS[setup]
        zero = {"zero_every": 8} if setup == "ballbar" else {}
        self.folder = Path(
            tempfile.mkdtemp(prefix="truepose-machine-", dir=MEMORY if MEMORY.is_dir() else None)
        )
        self.bench = Bench(a_cell(**cell))
        self.run = Run.create(self.folder, self.bench.cell, a_campaign(block=blocks, **zero), simulated=True)
        self.clock = JumpingClock()
        self.reported: list[dict[str, Any]] = []
        self.asked_to_move = True  # a new record may run
        self.crashed = False
        self.browser: sqlite3.Connection | None = None
        self.last_t_s = 0.0

    def teardown(self) -> None:
        if hasattr(self, "run"):
            try:
                self._comes_to_its_end()
            finally:
                self.run.close()
                shutil.rmtree(self.folder)

    def _comes_to_its_end(self) -> None:
        """Bring the campaign to its end with a person who only confirms, after any events."""
        while self.run.status().state not in ("succeeded", "failed"):
            self.execute([], [])
            self.the_record_is_true()
        status = self.run.status()
        assert status.done == status.total == self.readings
        assert (status.state == "succeeded") == (status.skipped < self.readings)

    def _heard(self, event: Event) -> None:
        assert event.t_s is not None
        assert event.t_s >= self.last_t_s
        self.last_t_s = event.t_s
        if event.kind == "reading" and event.data["set"] != "nest":
            assert event.data["pose"] not in {row["pose"] for row in self.reported}
            self.reported.append(dict(event.data))

    def _happen(self, what: str) -> None:
        database = self.run._store.database
        if what in ERRORS:
            raise ERRORS[what]
        if what.startswith("stop"):
            self.run.stop()
        if what.endswith("crash"):
            self.crashed = True
            with database._lock:  # SQLite's module does not survive a close in mid-call of another thread
                database._connection.close()
            raise Crash
        if what == "pause":
            self.run.pause()
        elif what == "clock":
            self.clock.calendar += 3600.0
        elif what == "full disk":
            fill_disk(self.run._store)
        elif what == "browser":
            database.script("PRAGMA busy_timeout = 1")
            self.browser = sqlite3.connect(self.folder / FILE, isolation_level=None, check_same_thread=False)
            self.browser.execute("BEGIN IMMEDIATE")
        elif what == "tracker moved":
            self.bench.tracker.origin[:] += 0.2

    def _happening(self, what: str) -> Callable[[], None]:
        return lambda: self._happen(what)

    def _answering(self, what: str) -> None:
        with suppress(Crash):  # whoever waits for the answer finds the record gone
            self._happen(what)

    @rule(
        happenings=st.lists(st.tuples(st.integers(1, 25), st.sampled_from(HAPPENINGS)), max_size=4),
        answers=st.lists(st.sampled_from(ANSWERS), max_size=4),
    )
    @precondition(lambda self: self.run.status().state in ("ready", "paused", "stopped"))
    def execute(self, happenings: list[tuple[int, str]], answers: list[Answer | str]) -> None:
        if not self.asked_to_move:
            self.run.resume(by="somebody")
        self.bench.faults = {self.bench.calls + n: self._happening(what) for n, what in happenings}
        self.bench.seated = None
        operator = Person(self.bench, answers, self._answering)
        self.asked_to_move = False
        try:
            outcome = self.run.execute(devices_of(self.bench, operator), self.clock, self._heard)
        except (Crash, ZeroDivisionError):
            outcome = None
        calls = self.bench.calls
        if self.browser is not None:
            self.browser.close()
            self.browser = None
        if self.crashed:
            self.crashed = False
            self.run.close()
            self.run = Run.open(self.folder)
            assert self.run.status().state in ("paused", "stopped")
        elif outcome is None:
            assert self.run.status().state == "paused"
        else:
            assert outcome.state.value == self.run.status().state
            assert outcome.state.value in ("succeeded", "failed", "paused", "stopped")
            assert self.run.status().reason == outcome.reason
        self.run._store.database.script("PRAGMA max_page_count = 1000000")
        assert self.bench.calls == calls

    @rule()
    @precondition(lambda self: self.run.status().state in ("paused", "stopped") and not self.asked_to_move)
    def nothing_moves_unless_resumed(self) -> None:
        calls = self.bench.calls
        with pytest.raises(NotResumed):
            self.run.execute(devices_of(self.bench), self.clock, self._heard)
        assert self.bench.calls == calls

    @rule()
    @precondition(lambda self: self.run.status().state in ("ready", "paused"))
    def stop_while_it_rests(self) -> None:
        self.run.stop()
        self.asked_to_move = False
        assert self.run.status().state == "stopped"

    @rule()
    def pause_while_it_rests(self) -> None:
        before = self.run.status().state
        self.run.pause()
        assert self.run.status().state == before

    @rule()
    def reopen(self) -> None:
        before = self.run.status()
        self.run.close()
        self.run = Run.open(self.folder)
        assert self.run.status().state == before.state
        assert self.run.status().done == before.done

    @invariant()
    def the_record_is_true(self) -> None:
        if not hasattr(self, "run"):
            return
        db = sqlite3.connect(self.folder / FILE)
        db.row_factory = sqlite3.Row
        good = db.execute(
            "SELECT a.id, a.pose, a.device_t_s, p.target, p.base_target, p.joints_deg, p.approach_deg, "
            "p.status AS outcome, b.status AS arrival, b.visit = p.visit AS same "
            "FROM attempt AS a JOIN pose AS p ON p.id = a.pose LEFT JOIN attempt AS b ON b.id = a.arrival "
            "WHERE a.kind = 'measure' AND a.status = 'good' "
            "AND p.kind = 'pose'"
        ).fetchall()
        measured = {
            row[0] for row in db.execute("SELECT id FROM pose WHERE status = 'measured' AND kind = 'pose'")
        }
        left = db.execute("SELECT count(*) FROM pose WHERE status IN ('planned', 'deferred')").fetchone()[0]
        opened = db.execute("SELECT count(*) FROM attempt WHERE status = 'open'").fetchone()[0]
        db.close()
        assert len({row["pose"] for row in good}) == len(good)
        assert measured == {row["pose"] for row in good}
        assert {row["attempt"] for row in self.reported} <= {row["id"] for row in good}
        for row in good:
            shot = self.bench.shots[row["device_t_s"]]
            assert (row["arrival"], row["same"]) == ("good", 1)
            assert shot.target == row["target"]
            assert shot.joints_deg == tuple(json.loads(row["joints_deg"]))
            assert shot.came_from_deg == tuple(json.loads(row["approach_deg"]))
            if self.setup == "ballbar":
                assert shot.spanned == (row["base_target"], row["target"])
            else:
                assert shot.quiet_moves >= 2  # approach and pose, and nothing in between or since
            assert self.setup != "one SMR" or shot.seated == row["target"]
        if self.run.status().state == "succeeded":
            assert left == 0
            assert opened == 0


TestCampaign = CampaignMachine.TestCase
TestCampaign.settings = settings(
    max_examples=int(os.environ.get("TRUEPOSE_MACHINE_EXAMPLES", "40")),
    stateful_step_count=10,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
