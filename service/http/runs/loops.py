"""Closed loops: measure, diagnose, follow up, correct, drive, verify.

`RECORD/loops/ID/` has `loop.json` and the results. The campaigns of a loop are runs like any others
(`RECORD/runs/ID-campaign1`). A loop that was cut off by the end of the service has failed; its runs come back
paused.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from acquisition import Campaign, Cell, Devices, LeaseDeadline, State
from acquisition.loop import Compute, LoopResult, check_loop
from acquisition.record import DeviceAcceptance
from calib.text import replace_file
from drivers.errors import AcquisitionError
from service.files import as_json
from service.http.runs.dry_runs import Expected, readings_of
from service.http.runs.loop_work import ABOUT, LoopStatus, LoopWork
from service.http.runs.run_manager import RunManager
from service.http.wire.bodies import LoopKept, ResponseBody
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
CUT_OFF = "The service ended in mid-loop. Its runs are kept; begin a new loop to go through it whole."


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
        folder.mkdir(parents=True, exist_ok=True)
        for document in readable(self.ids(), self._read):
            if State(document["state"]) not in ENDED:
                self._write(document | _state(State.FAILED) | {"reason": CUT_OFF, "run_id": None})

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
        return self._read(name)["version"] if work is None else work.wait(after, seconds)

    # -- making -------------------------------------------------------------------------------------------

    def check(self, cell: Cell, table: Mapping[str, Any], name: str, expected: Expected = _UNASKED) -> str:
        """Make a dry run: the first campaign is checked, nothing is opened.

        Raises
        ------
        ConfigError, UnsafePlan
            The campaign cannot be used, or its plan is unsafe.
        """
        check_loop(cell)
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
        check_loop(cell)
        self._book.refuse_busy()
        devices = self._open_devices(cell)
        status = self._new(name or cell.name, State.RUNNING, expected)
        own, folder = status.id, self._folder / status.id

        def done(compute: Compute, result: LoopResult) -> str:
            compute(loop_results.write, result, folder)
            return compute(self._datasets.keep, result.data, status.name)["id"]

        work = LoopWork(folder, status, self._book, cell, devices, lease, done)
        try:
            self._book.lend(own, lambda: work(campaign, poses))
        except Problem:  # another was quicker
            shutil.rmtree(folder)
            raise
        self._work[own] = work
        return own

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
        self._going_on(name).pause(by)

    def pause_all(self, by: str, reason: str) -> None:
        """Pause the loop that has the robot, also between two of its runs."""
        work = self._work.get(self._book.lent_to or "")
        if work is not None:
            work.pause(by, reason)

    def resume(self, name: str, lease: LeaseDeadline, accepted: DeviceAcceptance | None) -> None:
        """Resume a loop.

        Raises
        ------
        Problem
            404, or 409 if the loop is not paused.
        """
        self._going_on(name).resume(lease, accepted)

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
        return self._going_on(name).stop(by)

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
