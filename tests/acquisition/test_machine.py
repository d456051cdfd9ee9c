"""Anything at any device call, in any order: nothing is lost, nothing is doubled, nothing without its approach.

Hypothesis plays operator, bad luck and power cut. A crash closes the record's connection in the middle of
whatever is going on, as the end of the process would; the fakes remember the truth.
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from acquisition.database import FILE
from acquisition.run import Run
from acquisition.store import Event
from drivers.errors import BeamBroken, EmergencyStop, LinkLost, WrongMode
from drivers.interfaces import Answer
from tests.acquisition.fakes import (
    Bench,
    Crash,
    JumpingClock,
    SeatingOperator,
    a_campaign,
    a_cell,
    devices_of,
)

BLOCKS = [{"set": "calibration", "count": 2, "targets": ["T1", "T2"]}, {"set": "validation", "count": 1}]
MEMORY = Path("/dev/shm")  # no power is cut here, so the disk need not be waited for
HAPPENINGS = ("crash", "pause", "stop", "link", "beam", "manual", "estop", "stop then crash")


class CampaignMachine(RuleBasedStateMachine):
    """One record, executed again and again."""

    folder: Path
    bench: Bench
    run: Run

    @initialize(one_smr=st.booleans())
    def begin(self, one_smr: bool) -> None:
        self.folder = Path(
            tempfile.mkdtemp(prefix="truepose-machine-", dir=MEMORY if MEMORY.is_dir() else None)
        )
        self.bench = Bench(a_cell(instrument__one_smr=one_smr))
        self.one_smr = one_smr
        self.run = Run.create(self.folder, self.bench.cell, a_campaign(block=BLOCKS), simulated=True)
        self.clock = JumpingClock()
        self.told: list[dict[str, Any]] = []
        self.asked_to_move = True  # a new record may run

    def teardown(self) -> None:
        if hasattr(self, "run"):
            self.run.close()
            shutil.rmtree(self.folder)

    def _heard(self, event: Event) -> None:
        if event.kind == "reading" and event.data["set"] != "nest":
            assert event.data["pose"] not in {row["pose"] for row in self.told}
            self.told.append(dict(event.data))

    def _crash(self) -> None:
        self.run._store.database._connection.close()
        raise Crash

    def _happening(self, what: str) -> Callable[[], None]:
        def throw(error: BaseException) -> Callable[[], None]:
            def happen() -> None:
                raise error

            return happen

        def stop_and_crash() -> None:
            self.run.stop()
            self._crash()

        table: dict[str, Callable[[], object]] = {
            "crash": self._crash,
            "pause": lambda: self.run.pause(),
            "stop": lambda: self.run.stop(),
            "link": throw(LinkLost("lost")),
            "beam": throw(BeamBroken("broken")),
            "manual": throw(WrongMode("manual")),
            "estop": throw(EmergencyStop("pressed")),
            "stop then crash": stop_and_crash,
        }
        return lambda: void(table[what]())

    @rule(
        happenings=st.lists(st.tuples(st.integers(1, 25), st.sampled_from(HAPPENINGS)), max_size=4),
        answers=st.lists(st.sampled_from((Answer.CONFIRM, Answer.SKIP, Answer.ABORT)), max_size=3),
    )
    @precondition(lambda self: self.run.status().state in ("ready", "paused", "stopped"))
    def execute(self, happenings: list[tuple[int, str]], answers: list[Answer]) -> None:
        if not self.asked_to_move:
            self.run.resume(by="somebody")
        self.bench.faults = {self.bench.calls + n: self._happening(what) for n, what in happenings}
        self.bench.seated = None
        operator = SeatingOperator(self.bench, answers)
        self.asked_to_move = False
        try:
            outcome = self.run.execute(devices_of(self.bench, operator), self.clock, self._heard)
        except Crash:
            self.run.close()
            moves = self.bench.calls
            self.run = Run.open(self.folder)
            assert self.run.status().state in ("paused", "stopped")
            assert self.bench.calls == moves
        else:
            assert outcome.state.value == self.run.status().state
            assert outcome.state.value in ("succeeded", "failed", "paused", "stopped")

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
            "SELECT a.id, a.pose, a.device_t_s, p.target, p.joints_deg, p.approach_deg, p.status AS outcome, "
            "b.status AS arrival, b.visit = p.visit AS same FROM attempt AS a JOIN pose AS p ON p.id = a.pose "
            "LEFT JOIN attempt AS b ON b.id = a.arrival WHERE a.kind = 'measure' AND a.status = 'good' "
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
        assert {row["attempt"] for row in self.told} <= {row["id"] for row in good}
        for row in good:
            shot = self.bench.shots[row["device_t_s"]]
            assert (row["arrival"], row["same"]) == ("good", 1)
            assert shot.target == row["target"]
            assert shot.joints_deg == tuple(json.loads(row["joints_deg"]))
            assert shot.came_from_deg == tuple(json.loads(row["approach_deg"]))
            assert shot.quiet_moves >= 2  # approach and pose, and nothing in between or since
            assert not self.one_smr or shot.seated == row["target"]
        if self.run.status().state == "succeeded":
            assert left == 0
            assert opened == 0


def void(_: object) -> None:
    """A happening answers nothing."""


TestCampaign = CampaignMachine.TestCase
TestCampaign.settings = settings(
    max_examples=int(os.environ.get("TRUEPOSE_MACHINE_EXAMPLES", "100")),
    stateful_step_count=10,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
