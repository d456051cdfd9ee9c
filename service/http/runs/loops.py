"""Closed loops: measure, diagnose, follow up, correct, drive, verify.

`RECORD/loops/ID/` has `loop.json` and the results. The campaigns of a loop are runs like any others
(`RECORD/runs/ID-campaign1`). `asked.json` has what the loop was begun with. A loop that was cut off by the end of the
service is paused; nothing of it moves until it is resumed. Then finished campaigns are used as they are, an unfinished
one goes on, and everything else is computed again.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from acquisition import Campaign, Cell, Devices, LeaseDeadline, State
from acquisition.campaign import campaign_of_record
from acquisition.loop import Compute, LoopResult
from acquisition.record import DeviceAcceptance
from calib.text import replace_file
from drivers.errors import AcquisitionError
from service.files import as_json
from service.http.runs import errors
from service.http.runs.dry_runs import Expected, readings_of
from service.http.runs.loop_work import ABOUT, STOPPED, LoopStatus, LoopWork
from service.http.runs.run_manager import FINISH_S, RunManager
from service.http.wire.bodies import LoopAsked, LoopKept, ResponseBody
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
RESTS = (
    "The service ended in mid-loop; nothing moves. What was measured is kept; resume the loop to continue."
)


class LoopStore:
    """The loops of one record directory. Thread-safe."""

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
        self._folder, self._book, self._datasets, self._workers = folder, book, datasets, workers
        self._open_devices, self._simulated = open_devices, simulated
        self._work: dict[str, LoopWork] = {}
        self._beginning = threading.Lock()  # of two clients that continue one loop, one does
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

    def documents(self) -> list[dict[str, Any]]:
        """Return every loop, newest first, without those whose files are damaged."""
        return readable(self.ids(), self.document)

    def document(self, name: str) -> dict[str, Any]:
        """Return the document of a loop, with that of the current run.

        Raises
        ------
        Problem
            404, or 500 if it is damaged.
        """
        self._known(name)
        work = self._work.get(name)
        document = self._read(name) if work is None else work.document
        run = None if document["run_id"] is None else self._book.document(document["run_id"])
        if run is not None and State(document["state"]).active and State(run["state"]).active:
            document |= _state(State(run["state"]))  # a question to a person is one of the loop
        result = self._folder / name / RESULT
        done = document["state"] == State.SUCCEEDED.value and not document["dry_run"]
        return document | {
            "run": run,
            "result": read_kept(result, ResponseBody) if done else None,
            "report": path_of("reports", name) if done else None,
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
            time.sleep(seconds)  # only an order changes it
        return self._read(name)["version"]

    # -- making -------------------------------------------------------------------------------------------

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
        status = self._new(name or cell.name, State.SUCCEEDED, expected, dry_run=True, reason=reason)
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
        devices = self._open_devices(cell)
        status = self._new(name or cell.name, State.RUNNING, expected)
        folder = self._folder / status.id
        asked = {"cell": cell.source, "campaign": campaign.source, "poses": poses}
        replace_file(folder / ASKED, as_json(asked))
        self._write(status.as_dict())
        try:
            self._begin(status, cell, devices, campaign, poses, lease)
        except Problem:  # another was quicker
            shutil.rmtree(folder)
            raise
        return status.id

    def _begin(
        self,
        status: LoopStatus,
        cell: Cell,
        devices: Devices,
        campaign: Campaign,
        poses: int,
        lease: LeaseDeadline,
        accepted: DeviceAcceptance | None = None,
    ) -> None:
        own, folder = status.id, self._folder / status.id

        def done(compute: Compute, result: LoopResult) -> str:
            compute(loop_results.write, result, folder)
            return compute(self._datasets.keep, result.data, status.name)["id"]

        work = LoopWork(folder, status, self._book, cell, devices, lease, done, accepted)
        former, self._work[own] = self._work.get(own), work  # a stop reaches it from its first moment
        try:
            self._book.lend(own, lambda: work(campaign, poses))
        except Problem:
            self._work.pop(own)
            if former is not None:
                self._work[own] = former
            raise

    def _new(
        self, name: str, state: State, expected: Expected, *, dry_run: bool = False, reason: str = ""
    ) -> LoopStatus:
        own = new_id()
        (self._folder / own).mkdir()
        made = utc_text(time.time())
        return LoopStatus(
            own, name, made, self._simulated, state, dry_run=dry_run, reason=reason, outlook=expected.outlook
        )

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
            404, or 409 if the loop is not paused, or is of another cell or other devices.
        """
        with self._beginning:
            rests = self._rests(name)
            if rests:
                self._continue(name, cell, lease, accepted)
        if not rests:
            self._going_on(name).resume(lease, accepted)

    def _rests(self, name: str) -> bool:
        """Return whether a loop is paused without an execution."""
        self._known(name)
        work = self._work.get(name)
        document = self._read(name) if work is None else work.document
        return document["state"] == State.PAUSED.value and (work is None or work.over)

    def _continue(
        self, name: str, cell: Cell, lease: LeaseDeadline, accepted: DeviceAcceptance | None
    ) -> None:
        asked = read_kept(self._folder / name / ASKED, LoopAsked)
        work = self._work.get(name)
        document = self._read(name) if work is None else work.document
        if asked["cell"] != cell.source:
            raise errors.other_cell()
        if document["simulated"] != self._simulated:
            raise errors.other_devices(simulated=document["simulated"])
        gone = [run for run in document["runs"] if not self._book.record_of(run).is_dir()]
        if gone:
            raise Problem(409, f"Its run {gone[0]} was deleted.", "Begin a new loop.", code=8110)
        if self._book.lent_to == name:  # its thread is just ending
            self._book.join(FINISH_S)
        self._book.refuse_busy()
        campaign = campaign_of_record(asked["campaign"], f"loops/{name}/{ASKED}")
        known = {each.name: document[each.name] for each in fields(LoopStatus) if each.name in document}
        known |= {"steps": tuple(known["steps"]), "runs": tuple(known["runs"])}
        begun = LoopStatus(**known | {"state": State.RUNNING, "reason": "", "problem": None, "run_id": None})
        devices = self._open_devices(cell)
        try:
            self._begin(begun, cell, devices, campaign, asked["poses"], lease, accepted)
        except Problem:  # another was quicker
            self._write(document)
            raise

    def finish(self, run_id: str, lease: LeaseDeadline, by: str, reason: str) -> None:
        """Finish a run of the loop that has the robot; the loop goes on with its diagnosis.

        Raises
        ------
        Problem
            409: the loop has ended, or its run is that of the verification.
        NotResumed
            The run has ended, or has no reading that could be fitted.
        """
        self._going_on(self._book.lent_to or "").finish(run_id, lease, by, reason)

    def stop(self, name: str, by: str) -> list[AcquisitionError]:
        """Stop a loop; return the errors of devices that could not be stopped.

        No lease is needed.

        Raises
        ------
        Problem
            404, or 409 if the loop has ended.
        """
        if not self._rests(name):
            return self._going_on(name).stop(by)
        work = self._work.pop(name, None)
        document = self._read(name) if work is None else work.document
        ended = {"reason": STOPPED, "problem": None, "version": document["version"] + 1}
        self._write(document | _state(State.STOPPED) | ended)
        return []

    def _going_on(self, name: str) -> LoopWork:
        self._known(name)
        work = self._work.get(name)
        if work is None or State(work.document["state"]) in ENDED:
            raise Problem(409, "The loop has ended.", "Look at its runs and results.", code=8110)
        return work

    def close(self) -> None:
        """End all loops, because the service ends; nothing new begins."""
        for work in self._work.values():
            work.close()

    def _known(self, name: str) -> None:
        if not safe_id(name) or not (self._folder / name / ABOUT).is_file():
            raise not_found("loop", name)

    def _read(self, name: str) -> dict[str, Any]:
        return read_kept(self._folder / name / ABOUT, LoopKept)

    def _write(self, document: Mapping[str, Any]) -> None:
        replace_file(self._folder / document["id"] / ABOUT, as_json(dict(document)))


def _state(state: State) -> dict[str, Any]:
    return {"state": state.value, "state_code": state.code}
