"""Closed loops: measure, diagnose, follow up, correct, drive, verify.

`RECORD/loops/ID/` has `loop.json` and the results. The campaigns of a loop are runs like any others
(`RECORD/runs/ID-campaign1`). `asked.json` has what the loop was begun with. A loop that was cut off by the end of the
service is paused; nothing of it moves until it is resumed. Then finished campaigns are used as they are, an unfinished
one goes on, and everything else is computed again. Proofs of models are stored, ordered and resumed in the same way
(`service.http.runs.verifications`).
"""

from __future__ import annotations

import shutil
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from acquisition import Campaign, Cell, Devices, LeaseDeadline, State
from acquisition.campaign import campaign_of_record
from acquisition.loop import Equipment, Say, close_loop
from acquisition.record import DeviceAcceptance
from acquisition.run import STOPPED
from calib.text import replace_file
from drivers.errors import AcquisitionError
from service.files import as_json
from service.http.runs import errors
from service.http.runs.dry_runs import Expected, readings_of
from service.http.runs.loop_work import ABOUT, LoopStatus, LoopWork, Play
from service.http.runs.run_manager import FINISH_S, RunManager
from service.http.wire.bodies import LoopAsked, LoopKept, ResponseBody, WorkAsked
from service.http.wire.paths import path_of
from service.http.wire.problems import Problem, not_found
from service.http.work.datasets import DatasetStore
from service.http.work.stored_documents import read_kept, readable
from service.http.work.workers import Workers
from service.ids import new_id, safe_id
from service.job_folder import RESULT
from service.json_values import utc_text
from service.results.cell import loop_results
from service.wording import counted

_UNASKED = Expected()
ENDED = (State.SUCCEEDED, State.FAILED, State.STOPPED)
ASKED = "asked.json"
CUT_OFF = "The service ended in mid-loop. Its runs are kept; begin a new loop to go through it whole."
RESTS = "The service ended; nothing moves. What was measured is kept. Resume to continue."


class WorkStore(ABC):
    """The loops, or the verifications, of one record directory. Thread-safe.

    `kind` is what clients call it, `asked` the members of its file `ASKED`. `fitted` are the ends of the names of the
    runs that a diagnosis fits; only those can be finished early.
    """

    kind, fitted = "loop", ("campaign1", "campaign-follow-up")
    asked: type[WorkAsked] = LoopAsked

    def __init__(
        self,
        folder: Path,
        book: RunManager,
        open_devices: Callable[[Cell], Devices],
        workers: Workers,
        *,
        simulated: bool,
    ) -> None:
        self._folder, self._book, self._workers = folder, book, workers
        self._open_devices, self._simulated = open_devices, simulated
        self._work: dict[str, LoopWork] = {}
        # Of two clients that continue or stop what rests, one does. It is held for moments only.
        self._turn = threading.Lock()
        folder.mkdir(parents=True, exist_ok=True)
        for document in readable(self.ids(), self._read):
            if State(document["state"]) not in ENDED:
                state, reason = State.FAILED, CUT_OFF
                if (folder / document["id"] / ASKED).is_file():
                    state, reason = State.PAUSED, RESTS
                self._write(document | _state(state) | {"reason": reason, "run_id": None})

    def ids(self) -> list[str]:
        """Return the ids of all loops, newest first."""
        names = (p.name for p in self._folder.iterdir() if safe_id(p.name) and (p / ABOUT).is_file())
        return sorted(names, reverse=True)

    def document(self, name: str) -> dict[str, Any]:
        """Return the document of a loop, with that of the current run.

        Raises
        ------
        Problem
            404, or 500 if it is damaged.
        """
        self._known(name)
        document = self._now(name)
        run = None if document["run_id"] is None else self._book.document(document["run_id"])
        if run is not None and State(document["state"]).active and State(run["state"]).active:
            document |= _state(State(run["state"]))  # a question to a person is one of the loop
        result = self._folder / name / RESULT
        done = document["state"] == State.SUCCEEDED.value and not document["dry_run"]
        return document | {
            "run": run,
            "result": read_kept(result, ResponseBody) if done else None,
            "report": path_of("reports", name) if done and self.kind == "loop" else None,
        }

    def runs_in_hand(self) -> tuple[str, ...]:
        """Return the ids of the runs of the loop that has the robot.

        They include finished runs, which the loop still reads.
        """
        work = self._work.get(self._book.lent_to or "")
        return () if work is None else tuple(work.document["runs"])

    def wait(self, name: str, after: int, seconds: float) -> int:
        """Return the version, waiting up to `seconds` for one beyond `after`.

        Raises
        ------
        Problem
            404: there is no such loop.
        """
        self._known(name)
        work = self._work.get(name)
        if work is not None:
            return work.wait(after, seconds)
        if self._rests(name):
            time.sleep(seconds)  # a slice of a long poll, which then asks again
        return self._read(name)["version"]

    # -- orders -------------------------------------------------------------------------------------------

    def pause(self, name: str, by: str) -> None:
        """Pause a loop after the current reading.

        Raises
        ------
        Problem
            404, or 409 if the loop has ended.
        """
        if not self._rests(name):
            self._going_on(name).pause(by)

    def pause_all(self, by: str, reason: str) -> None:
        """Pause the loop that has the robot, also between two of its runs."""
        work = self._work.get(self._book.lent_to or "")
        if work is not None:
            work.pause(by, reason)

    def resume(self, name: str, cell: Cell, lease: LeaseDeadline, accepted: DeviceAcceptance | None) -> None:
        """Resume a loop, also one that was cut off; `cell` is the cell now.

        Raises
        ------
        Problem
            404, or 409 if it is not paused, or is of another cell or other devices.
        """
        if not self._rests(name) or not self._continue(name, cell, lease, accepted):
            self._going_on(name).resume(lease, accepted)

    def _rests(self, name: str) -> bool:
        """Return whether a loop is paused without an execution."""
        self._known(name)
        work = self._work.get(name)
        return self._now(name)["state"] == State.PAUSED.value and (work is None or work.over)

    def _continue(
        self, name: str, cell: Cell, lease: LeaseDeadline, accepted: DeviceAcceptance | None
    ) -> bool:
        """Execute a resting loop again; return False if another order came first."""
        document = self._now(name)
        if self._asked(name)["cell"] != cell.source:
            raise errors.other_cell()
        if document["simulated"] != self._simulated:
            raise errors.other_devices(simulated=document["simulated"])
        gone = [run for run in document["runs"] if not self._book.record_of(run).is_dir()]
        if gone:
            raise Problem(409, f"Its run {gone[0]} was deleted.", f"Begin a new {self.kind}.", code=8110)
        if self._book.lent_to == name:  # its thread is just ending
            self._book.join(FINISH_S)
        devices = self._open_devices(cell)
        with self._turn:
            if not self._rests(name):
                return False
            self._book.refuse_busy()
            document = self._now(name)
            known = {each.name: document[each.name] for each in fields(LoopStatus) if each.name in document}
            known |= {"steps": tuple(known["steps"]), "runs": tuple(known["runs"])}
            known |= {"state": State.RUNNING, "reason": "", "problem": None, "run_id": None}
            try:
                self._begin(LoopStatus(**known), cell, devices, lease, accepted)
            except Problem:  # another was quicker
                self._write(document)
                raise
        return True

    def finish(self, run_id: str, lease: LeaseDeadline, by: str, reason: str) -> None:
        """Finish a run of the loop that has the robot; the loop goes on with its diagnosis.

        Raises
        ------
        Problem
            409: it has ended, or its run verifies a model.
        NotResumed
            The run has ended, or has no reading that could be fitted.
        """
        work = self._going_on(self._book.lent_to or "")
        if not run_id.endswith(self.fitted):
            raise Problem(
                409,
                "This run verifies the correction: with a part of its poses it would prove nothing.",
                f"Let it end, or stop the {self.kind}; what is measured is kept.",
                code=3104,
            )
        work.finish(run_id, lease, by, reason)

    def stop(self, name: str, by: str) -> list[AcquisitionError]:
        """Stop a loop; return the errors of devices that could not be stopped.

        No lease is needed.

        Raises
        ------
        Problem
            404, or 409 if the loop has ended.
        """
        if self._rests(name):
            with self._turn:
                if self._rests(name):
                    document = self._now(name)
                    ended = {"reason": STOPPED, "problem": None, "version": document["version"] + 1}
                    self._write(document | _state(State.STOPPED) | ended)
                    self._work.pop(name, None)
                    return []
        return self._going_on(name).stop(by)

    def _going_on(self, name: str) -> LoopWork:
        self._known(name)
        work = self._work.get(name)
        if work is None or State(work.document["state"]) in ENDED:
            raise Problem(409, f"The {self.kind} has ended.", "Look at its runs and results.", code=8110)
        return work

    # -- making -------------------------------------------------------------------------------------------

    def _start(self, status: LoopStatus, cell: Cell, lease: LeaseDeadline) -> str:
        """Begin what was just made, and return its id; nothing is kept of it if it cannot begin.

        Raises
        ------
        Problem
            409: the robot is busy.
        """
        try:
            self._book.refuse_busy()
            devices = self._open_devices(cell)
            self._write(status.as_dict())
            self._begin(status, cell, devices, lease)
        except BaseException:  # perhaps another was quicker
            shutil.rmtree(self._folder / status.id)
            raise
        return status.id

    def _begin(
        self,
        status: LoopStatus,
        cell: Cell,
        devices: Devices,
        lease: LeaseDeadline,
        accepted: DeviceAcceptance | None = None,
    ) -> None:
        own, play = status.id, self._play(status, cell)
        work = LoopWork(self._folder / own, status, self._book, cell, devices, lease, play, accepted)
        former, self._work[own] = self._work.get(own), work  # a stop reaches it from its first moment
        try:
            self._book.lend(own, work, self.kind)
        except Problem:
            self._work.pop(own)
            if former is not None:
                self._work[own] = former
            raise

    @abstractmethod
    def _play(self, status: LoopStatus, cell: Cell) -> Play:
        """Return what drives it, as its file `ASKED` says."""

    def _new(
        self,
        name: str,
        state: State,
        outlook: dict[str, Any] | None = None,
        *,
        dry_run: bool = False,
        reason: str = "",
    ) -> LoopStatus:
        own = new_id()
        (self._folder / own).mkdir()
        made = utc_text(time.time())
        return LoopStatus(
            own, name, made, self._simulated, state, dry_run=dry_run, reason=reason, outlook=outlook
        )

    def close(self) -> None:
        """End all loops, because the service ends; nothing new begins."""
        for work in self._work.values():
            work.close()

    def _now(self, name: str) -> dict[str, Any]:
        work = self._work.get(name)
        return self._read(name) if work is None else work.document

    def _asked(self, name: str) -> dict[str, Any]:
        return read_kept(self._folder / name / ASKED, self.asked)

    def _known(self, name: str) -> None:
        if not safe_id(name) or not (self._folder / name / ABOUT).is_file():
            raise not_found(self.kind, name)

    def _read(self, name: str) -> dict[str, Any]:
        return read_kept(self._folder / name / ABOUT, LoopKept)

    def _write(self, document: Mapping[str, Any]) -> None:
        replace_file(self._folder / document["id"] / ABOUT, as_json(dict(document)))


class LoopStore(WorkStore):
    """The loops of one record directory; `datasets` keeps the readings of finished ones."""

    def __init__(
        self,
        folder: Path,
        book: RunManager,
        datasets: DatasetStore,
        open_devices: Callable[[Cell], Devices],
        workers: Workers,
        *,
        simulated: bool,
    ) -> None:
        super().__init__(folder, book, open_devices, workers, simulated=simulated)
        self._datasets = datasets

    def check(self, cell: Cell, table: Mapping[str, Any], name: str, expected: Expected = _UNASKED) -> str:
        """Make a dry run: the first campaign is checked, nothing is opened.

        Raises
        ------
        ConfigError, UnsafePlan
            The campaign cannot be used, or its plan is unsafe.
        """
        _, total = self._workers.call(readings_of, cell, table)
        found = expected.words or f"{counted(total, 'reading')} in the first campaign; nothing has moved."
        reason = f"Checked only: {found}"
        status = self._new(name or cell.name, State.SUCCEEDED, expected.outlook, dry_run=True, reason=reason)
        self._write(status.as_dict())
        return status.id

    def start(
        self,
        cell: Cell,
        campaign: Campaign,
        name: str,
        poses: int,
        lease: LeaseDeadline,
        expected: Expected = _UNASKED,
    ) -> str:
        """Begin a loop; the robot moves.

        Raises
        ------
        Problem
            409: the robot is busy.
        ConfigError, UnsafePlan
            The loop or its campaign cannot be used.
        """
        self._book.refuse_busy()
        status = self._new(name or cell.name, State.RUNNING, expected.outlook)
        asked = {"cell": cell.source, "campaign": campaign.source, "poses": poses}
        replace_file(self._folder / status.id / ASKED, as_json(asked))
        return self._start(status, cell, lease)

    def _play(self, status: LoopStatus, cell: Cell) -> Play:
        folder, asked = self._folder / status.id, self._asked(status.id)
        campaign = campaign_of_record(asked["campaign"], f"loops/{status.id}/{ASKED}")

        def play(equipment: Equipment, say: Say) -> str:
            result = close_loop(equipment, campaign, folder, poses=asked["poses"], say=say)
            equipment.compute(loop_results.write, result, folder)
            return equipment.compute(self._datasets.keep, result.data, status.name)["id"]

        return play


def _state(state: State) -> dict[str, Any]:
    return {"state": state.value, "state_code": state.code}
