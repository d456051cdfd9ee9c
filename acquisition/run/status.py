"""The execution of a run, and its status for people and programs with the fields of the contract."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from acquisition.campaign.plan import Forecast
from acquisition.record.attempts import Attempts
from acquisition.record.database import is_owned, share_of_path
from acquisition.record.readings import accuracy_of, drift_of
from acquisition.record.states import LEFT_BEHIND, State
from acquisition.record.store import RecordStore
from acquisition.run.clock import Clock
from acquisition.run.early_end import as_ended, early_end, open_order
from acquisition.run.orders.control import Control
from acquisition.run.orders.stop_orders import StopOrders
from acquisition.run.outcome import verdict_of
from acquisition.run.prompts.prompt_queue import PromptQueue
from acquisition.run.rig.rig import DevicePair


@dataclass(frozen=True)
class RunStatus:
    """The status of a run.

    Attributes
    ----------
    done, total
        Numbers of readings of robot poses; skipped ones count as done.
    seconds_left
        Remaining real time, s.
    drift
        Drift of the reference pose (`record.readings`); None before its second reading.
    path
        The last waypoint that a path reached, their number, and the samples and lost samples of both streams so far;
        None without a path.
    finished_early
        Who ended it early, when, why, and how many readings it has (`run.early_end`); None if it was not.
    accuracy
        What the last look of an adaptive block found (`run.adaptive`), and the `history` of all looks.
    """

    id: str
    name: str
    state: str
    state_code: int
    reason: str
    version: int
    done: int
    total: int
    skipped: int = 0
    prompt: dict[str, Any] | None = None
    last_reading: dict[str, Any] | None = None
    drift: dict[str, Any] | None = None
    seconds_left: float | None = None
    simulated: bool = False
    path: dict[str, Any] | None = None
    accuracy: dict[str, Any] | None = None
    finished_early: dict[str, Any] | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the values for JSON."""
        return asdict(self)


class Pace:
    """The pace of an execution compared with the forecast of its plan.

    `done` is the number of readings at its start.
    """

    def __init__(self, clock: Clock, done: int, forecast: Future[Forecast]) -> None:
        self._clock, self._done, self._forecast = clock, done, forecast
        self._since = clock.now()

    def seconds_left(self, done: int, share: float) -> float | None:
        """Return the remaining real time, s, when `share` of the current reading is over.

        It is None before the forecast is ready, or if none could be made.
        """
        if not self._forecast.done() or self._forecast.exception() is not None:
            return None
        elapsed = self._clock.now() - self._since
        return self.real_s(self._forecast.result().seconds_left(done, self._done, elapsed, share))

    def real_s(self, seconds: float) -> float:
        """Return how long `seconds` of the campaign take."""
        return seconds / self._clock.time_scale


def status_of(store: RecordStore, pace: Pace | None = None, trouble: str | None = None) -> RunStatus:
    """Return the status of a run.

    `pace` is None if it does not execute; `trouble` is the reason why the record could not take a pause.
    """
    row, counts = store.campaign, store.counts()
    state = State.PAUSED if trouble else State(row["state"])
    skipped = counts.get("skipped", 0)
    done, total = counts.get("measured", 0) + skipped, sum(counts.values())
    path, accuracy = store.last_waypoint(), accuracy_of(store)
    seconds_left = None if pace is None else pace.seconds_left(done, share_of_path(store.database, path))
    if pace is not None and accuracy is not None and accuracy["minutes_left"] is not None:
        seconds_left = pace.real_s(60.0 * accuracy["minutes_left"])  # the plan has the next batch only
    return RunStatus(
        id=row["id"],
        name=row["name"],
        state=state.value,
        state_code=state.code,
        reason=trouble or row["reason"],
        version=store.version,
        done=done,
        total=total,
        skipped=skipped,
        prompt=Attempts(store).open_prompt() if state is State.WAITING else None,
        last_reading=store.last_reading(),
        drift=None if (drift := drift_of(store)) is None else drift.as_dict(),
        seconds_left=seconds_left,
        simulated=bool(row["simulated"]),
        path=path,
        accuracy=accuracy,
        finished_early=early_end(store) if state is State.SUCCEEDED else None,
    )


def read_status(record_dir: Path) -> RunStatus:
    """Return the status of a record that another program may be running.

    A run that a killed program left behind is paused, or has succeeded if it was to be finished.

    Raises
    ------
    RecordError
        There is no record.
    StorageError
        The record cannot be read.
    """
    store = RecordStore.open(record_dir, writer=False)
    try:
        seen = status_of(store)
        # The state is read again, because the owner may just have ended.
        if State(seen.state).active and not is_owned(record_dir) and store.state.active:
            seen = status_of(store, trouble=LEFT_BEHIND)
            if (order := open_order(store)) is not None:
                done, (_, why) = State.SUCCEEDED, verdict_of(store, ended_by=order["by"])
                ended = as_ended(store, order)
                seen = replace(seen, state=done.value, state_code=done.code, reason=why, finished_early=ended)
        return seen
    finally:
        store.close()


@dataclass
class CampaignExecution:
    """The parts of a run that exist only while devices are in use."""

    control: Control
    rig: DevicePair
    desk: PromptQueue
    pace: Pace
    noting: StopOrders
