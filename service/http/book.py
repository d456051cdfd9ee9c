"""The runs of the record directory, and the one of them that may be using the robot.

    RECORD/runs/ID/record.sqlite3    a run, by `acquisition`
    RECORD/runs/ID/dry_run.json      a campaign that was only checked

Nothing is executed when the book is opened: runs that were going on when the program ended come back paused.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from acquisition import Campaign, Cell, Devices, Event, Run, RunStatus, State, checked_plan, read_status
from acquisition.errors import RecordError, RecordInUse
from calib.files import replace_file
from drivers.errors import AcquisitionError
from service.files import as_json
from service.http.names import new_id, safe_id
from service.http.problems import Problem, not_found
from service.plain import finite
from service.wording import counted

DRY_RUN = "dry_run.json"
PAUSE_S = 15.0  # for the reading in hand when the service ends; then the robot is stopped
FINISH_S = 5.0


@dataclass
class _Execution:
    run_id: str
    thread: threading.Thread
    begun: threading.Event = field(default_factory=threading.Event)


class Book:
    """Thread-safe. `open_devices`: the devices of a cell, not yet connected."""

    def __init__(self, folder: Path, open_devices: Callable[[Cell], Devices], *, simulated: bool) -> None:
        self._folder, self._open_devices, self._simulated = folder, open_devices, simulated
        self._mutex = threading.RLock()
        self._runs: dict[str, Run] = {}
        self._errors: dict[str, AcquisitionError] = {}
        self._execution: _Execution | None = None
        folder.mkdir(parents=True, exist_ok=True)
        for name in self.ids():
            self._recover(name)

    def _recover(self, name: str) -> None:
        try:
            if not (self._folder / name / DRY_RUN).is_file() and State(self._look(name).state).active:
                self._runs[name] = Run.open(self._folder / name)
        except RecordInUse:
            return  # the command line runs it; it can be looked at
        except RecordError:
            return  # the program ended before the record was begun

    def _look(self, name: str) -> RunStatus:
        return read_status(self._folder / name)

    def ids(self) -> list[str]:
        """Newest first."""
        return sorted((p.name for p in self._folder.iterdir() if safe_id(p.name)), reverse=True)

    def documents(self) -> list[dict[str, Any]]:
        """Every run, newest first; folders that hold none are left out."""
        out = []
        for name in self.ids():
            try:
                out.append(self.document(name))
            except RecordError:
                continue
        return out

    def document(self, name: str) -> dict[str, Any]:
        """The contract's document of a run. Raises Problem 404."""
        self._known(name)
        dry = self._dry(name)
        if dry is not None:
            return dry
        self._let_finish(name)
        with self._mutex:
            run, error = self._runs.get(name), self._errors.get(name)
        status = self._look(name) if run is None else run.status()
        return finite(status.as_dict()) | {
            "id": name,
            "dry_run": False,
            "error": None if error is None else error.as_dict(),
        }

    def _let_finish(self, name: str) -> None:
        """A run that has just ended its execution is shown once robot and record are free again."""
        execution = self._execution
        if execution is None or execution.run_id != name or not execution.begun.is_set():
            return
        if not State(self._runs[name].status().state).active:
            execution.thread.join(FINISH_S)

    def get(self, name: str) -> Run:
        """The run itself, opened where it is not. Raises Problem 404 and 409 (dry run), RecordInUse."""
        self._known(name)
        if self._dry(name) is not None:
            raise Problem(
                409, "This was a dry run: nothing moves.", "Start it with dry_run = false.", code=8103
            )
        with self._mutex:
            if name not in self._runs:
                self._runs[name] = Run.open(self._folder / name)
            return self._runs[name]

    def path(self, name: str) -> Path:
        """The folder of a run's record. Raises Problem 404."""
        self._known(name)
        return self._folder / name

    def _known(self, name: str) -> None:
        if not safe_id(name) or not (self._folder / name).is_dir():
            raise not_found("run", name)

    def _dry(self, name: str) -> dict[str, Any] | None:
        file = self._folder / name / DRY_RUN
        return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None

    # -- making and executing ----------------------------------------------------------------------------

    def check(self, cell: Cell, campaign: Campaign, name: str) -> str:
        """A dry run: everything is checked, nothing is opened. Raises ConfigError, UnsafePlan."""
        visits = checked_plan(cell, campaign)
        total = sum(len(visit.targets) for visit in visits if visit.kind == "pose")
        folder = self._folder / new_id()
        folder.mkdir()
        done = State.SUCCEEDED
        document = {
            "id": folder.name,
            "name": name or cell.name,
            "state": done.value,
            "state_code": done.code,
            "reason": f"Checked only: {counted(len(visits), 'visit')}, {counted(total, 'reading')}; nothing has moved.",
            "version": 1,
            "done": 0,
            "total": total,
            "skipped": 0,
            "prompt": None,
            "last_reading": None,
            "seconds_left": None,
            "simulated": self._simulated,
            "dry_run": True,
            "error": None,
        }
        replace_file(folder / DRY_RUN, as_json(document))
        return folder.name

    def start(self, cell: Cell, campaign: Campaign, name: str) -> str:
        """Make a run and let the robot move. Raises Problem 409 while another uses the robot, ConfigError ..."""
        with self._mutex:
            self.refuse_busy()
            devices = self._open_devices(cell)
            run_id = new_id()
            run = Run.create(
                self._folder / run_id, cell, campaign, simulated=self._simulated, name=name or cell.name
            )
            self._runs[run_id] = run
            self._begin(run_id, run, devices)
        return run_id

    def resume(self, name: str, by: str, cell: Cell) -> None:
        """Let a paused or stopped run go on. Raises Problem, NotResumed, RecordInUse."""
        run = self.get(name)
        if (
            run.cell.source != cell.source
        ):  # it has the addresses, limits and boxes of that cell, not of this one
            raise Problem(
                409,
                "The run was begun with another cell file.",
                "Start the service with the cell file of the run, or use 'truepose campaign resume'.",
                code=8109,
            )
        self._let_finish(name)
        with self._mutex:
            self.refuse_busy()
            status = run.status()
            if status.simulated != self._simulated:
                was = "simulated" if status.simulated else "real"
                raise Problem(
                    409,
                    f"The run was measured on {was} devices, which this service does not use.",
                    f"Start the service {'with' if status.simulated else 'without'} --simulate.",
                    code=8104,
                )
            devices = self._open_devices(run.cell)
            if status.state != State.READY.value:
                run.resume(by=by)
            self._begin(name, run, devices)

    def refuse_busy(self) -> None:
        """Raises Problem 409 with the id of the run that uses the robot."""
        execution = self._execution
        if execution is not None:
            raise Problem(
                409,
                f"The robot is busy with run {execution.run_id}.",
                "Wait until that run has ended, or pause or stop it.",
                code=8105,
                headers={"Retry-After": "5"},
                run_id=execution.run_id,
            )

    @property
    def busy_with(self) -> str | None:
        """The id of the run that uses the robot."""
        execution = self._execution
        return None if execution is None else execution.run_id

    def _begin(self, name: str, run: Run, devices: Devices) -> None:
        def work() -> None:
            try:
                outcome = run.execute(devices, on_event=heard)
                if outcome.error is not None:
                    self._errors[name] = outcome.error
            except AcquisitionError as error:
                self._errors[name] = error
            finally:
                execution.begun.set()
                self._execution = None

        def heard(_: Event) -> None:
            execution.begun.set()

        execution = _Execution(name, threading.Thread(target=work, name=f"run {name}"))
        self._errors.pop(name, None)
        self._execution = execution
        execution.thread.start()

    # -- orders to whatever runs -------------------------------------------------------------------------

    def pause(self, name: str, by: str) -> None:
        """The run ends after the reading in hand. Raises Problem, RecordInUse, StorageError."""
        run, execution = self.get(name), self._execution
        if execution is not None and execution.run_id == name:
            execution.begun.wait(FINISH_S)  # a run that has not begun yet cannot be paused, and would go on
        run.pause(by=by)

    def pause_all(self, by: str) -> None:
        """The run that uses the robot ends after the reading in hand."""
        execution = self._execution
        if execution is not None:
            self.pause(execution.run_id, by)

    def stop_all(self, by: str) -> None:
        """The run that uses the robot ends now."""
        execution = self._execution
        if execution is not None:
            self._runs[execution.run_id].stop(by=by)

    def close(self) -> None:
        """Pause, after a while stop, what runs; give every record up."""
        execution = self._execution
        if execution is not None:
            self.pause_all(by="service ends")
            execution.thread.join(PAUSE_S)
            if execution.thread.is_alive():
                self.stop_all(by="service ends")
                execution.thread.join()
        with self._mutex:
            for run in self._runs.values():
                run.close()
            self._runs.clear()
