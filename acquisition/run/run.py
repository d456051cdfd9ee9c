"""One run of a campaign: the interface for command line, HTTP service and closed loop.

    run = Run.create(folder, cell, campaign)          # or Run.open(folder): comes back paused after a crash
    outcome = run.execute(open_devices(cell), on_event=show)
    run.resume(by="anna"); run.execute(...)           # a paused run moves only after an explicit resume

`execute` blocks until the run is paused, stopped or done, and leaves the devices disarmed and disconnected.
Everything else may be called from any thread meanwhile.
"""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path

from acquisition.campaign.campaign import Campaign, campaign_of_record
from acquisition.campaign.plan import Visit, check_plan, make_plan
from acquisition.cell.cell import Cell, cell_of_record, check_identity
from acquisition.cell.devices import Devices
from acquisition.errors import NotResumed, StorageError
from acquisition.record.attempts import Attempts
from acquisition.record.device_serials import DeviceAcceptance, Individual, Individuals, individual_of
from acquisition.record.states import State
from acquisition.record.store import Event, EventTime, RecordStore
from acquisition.run.clock import Clock, ScaledClock
from acquisition.run.duration import Begin, at_once, forecast_of
from acquisition.run.early_end import NOT_AT_REST, end_early, note_order, open_order
from acquisition.run.orders.control import ON_REQUEST, STOPPED, Control, Pausing, Stopping
from acquisition.run.orders.lease import LeaseDeadline
from acquisition.run.orders.robot_lock import Mover
from acquisition.run.orders.stop_orders import StopOrders
from acquisition.run.outcome import ExecutionOutcome, not_resumed, verdict_of
from acquisition.run.prompts.prompt_queue import PromptQueue
from acquisition.run.rig.device_state import DeviceStates, KnownDevice
from acquisition.run.rig.rig import ConnectedDevice, DevicePair, add_unreached_devices
from acquisition.run.sequencer import Sequencer
from acquisition.run.status import CampaignExecution, Pace, RunStatus, status_of
from acquisition.run.visits import Visits
from drivers.errors import AcquisitionError
from drivers.interfaces import Answer
from drivers.operator import UnknownPrompt

PROMPT = "prompt.svg"
"""What the prompt that is asked is about, in the folder of the record."""
LEAST_FREE_BYTES = 50_000_000


def checked_plan(cell: Cell, campaign: Campaign) -> list[Visit]:
    """Plan and check a campaign in this cell without a record: a dry run.

    Raises
    ------
    ConfigError
        The campaign does not fit the cell.
    UnsafePlan
        A pose or move is not clear.
    """
    visits = make_plan(cell, campaign)
    check_plan(cell, visits)
    return visits


class Run:
    """A record and, while it executes, its devices."""

    def __init__(self, store: RecordStore, cell: Cell, campaign: Campaign) -> None:
        self._store = store
        self.cell = cell
        self.campaign = campaign
        self._mutex = threading.Lock()  # who executes; taken for moments only
        self._execution: CampaignExecution | None = None
        self._states: DeviceStates | None = None  # of the last execution
        self._resumed = False
        self._accepted: DeviceAcceptance | None = (
            None  # another device than the record's, in the next execution
        )
        self._mover: Mover | None = None
        self._trouble: str | None = None  # why the record could not store a state

    @classmethod
    def create(
        cls,
        record_dir: Path,
        cell: Cell,
        campaign: Campaign,
        *,
        simulated: bool = False,
        name: str = "",
        visits: Sequence[Visit] | None = None,
    ) -> Run:
        """Plan, check everything, and create the record. Nothing moves, no device is touched.

        Parameters
        ----------
        visits
            Result of an earlier `checked_plan` for this cell and campaign. Default: plan now.

        Raises
        ------
        ConfigError, UnsafePlan
            The campaign does not fit the cell, or may not be driven.
        RecordError, RecordInUse
            There is a record already, or another program runs it.
        StorageError
            The record cannot be written.
        """
        store = RecordStore.create(
            record_dir,
            name or cell.name,
            cell.source,
            campaign.source,
            checked_plan(cell, campaign) if visits is None else visits,
            simulated=simulated,
        )
        run = cls(store, cell, campaign)
        if campaign.robot and not simulated:  # a rehearsal is not judged
            run.need(individual_of({"role": "robot", **campaign.robot}))
        return run

    @classmethod
    def open(cls, record_dir: Path) -> Run:
        """Open an existing record; a run that was active when its program ended is now paused.

        If it was to be finished, it has succeeded.

        Raises
        ------
        RecordError, RecordInUse
            There is no record, or another program runs it.
        StorageError
            The record cannot be read.
        """
        store = RecordStore.open(record_dir)
        try:
            with store.changing():
                order = open_order(store) if store.state.active else None
                store.recover()
                if order is not None:
                    end_early(store, order)
            row = store.campaign
            where = str(store.database.path)
            return cls(store, cell_of_record(row["cell"], where), campaign_of_record(row["campaign"], where))
        except BaseException:
            store.close()
            raise

    def expect(self, individuals: Sequence[Individual]) -> None:
        """Require the robot and the instrument of another record, before this one begins."""
        Individuals(self._store).expect(individuals)

    def need(self, individual: Individual) -> None:
        """Allow motion only with this robot or instrument, in all programs.

        A model of it will judge the readings.
        """
        Individuals(self._store).need(individual)

    def individuals(self) -> list[Individual]:
        """Return the robot and the instrument that were met last."""
        return list(Individuals(self._store).now().values())

    def close(self) -> None:
        """Release the record. Not while executing."""
        self._store.close()

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- execution ----------------------------------------------------------------------------------------

    def execute(
        self,
        devices: Devices,
        clock: Clock | None = None,
        on_event: Callable[[Event], None] | None = None,
        lease: LeaseDeadline | None = None,
        begin: Begin = at_once,
    ) -> ExecutionOutcome:
        """Take the missing readings, and block until the run ends.

        Parameters
        ----------
        clock
            Default: real time, scaled for a simulated run.
        lease
            Lease of an owner who beats. When it ends, the robot comes to rest and the run is paused. Default: the
            caller lives as long as this call.
        begin
            Begins computations from the record: the forecast, from which the status takes the remaining time, and
            the looks of an adaptive block.

        Raises
        ------
        RobotInUse
            Another campaign moves the robot.
        NotResumed
            The run is paused and was not resumed.
        StorageError
            The record cannot even be started; later errors of devices and record are in the outcome.
        """
        simulated = bool(self._store.campaign["simulated"])
        clock = clock or ScaledClock(self.cell.time_scale if simulated else 1.0)
        with ExitStack() as stack:
            if (
                not simulated and not self.cell.robot.declared.by_hand
            ):  # there may be any number of simulated cells
                self._mover = stack.enter_context(Mover(self.cell.robot.url))
            if on_event is not None:
                stack.enter_context(self._store.listening(on_event))
            execution = self._begin(devices, clock, begin)
            if lease is not None:
                stack.enter_context(lease.watched(lambda: self._owner_is_silent(lease, execution.control)))
            sequencer = Sequencer(
                self._store,
                self.cell,
                self.campaign,
                execution.rig,
                execution.control,
                execution.desk,
                clock,
                begin,
            )
            ending, error = State.PAUSED, None
            reason, at_rest = "The program was interrupted.", False
            try:
                sequencer.run()
                ending, reason = verdict_of(self._store)
            except Pausing as pausing:
                reason, at_rest = str(pausing), not execution.rig.adrift
                if execution.rig.adrift:  # no one supervises a move that is still being made
                    execution.rig.halt()
            except Stopping:
                ending, reason = State.STOPPED, STOPPED
            except AcquisitionError as caught:
                error, reason = caught, caught.sentence
                if execution.control.stopping:  # independently of the reaction of the devices
                    ending, reason = State.STOPPED, f"Stopped on request; {reason}"
                execution.rig.halt()
            finally:
                # Also for Ctrl-C and for faults of this program: nothing stays armed, the record says so.
                execution.rig.release()
                if ending is State.STOPPED or execution.rig.adrift:
                    reason = add_unreached_devices(reason, execution.rig.unheard)
                ended = self._end(ending, reason, may_finish=at_rest)
        return ExecutionOutcome(ended.state, ended.reason, ended.error or error)

    def _begin(self, devices: Devices, clock: Clock, begin: Begin) -> CampaignExecution:
        forecast = begin(
            forecast_of, self.folder
        )  # before the mutex, which a stop needs: it may take its time
        with self._mutex:
            state = self._store.state
            if self._execution is not None or not (state is State.READY or self._resumed):
                raise not_resumed(state, f"the campaign is {state.value}", "execute")
            self._check_disk()
            self._trouble = None
            self._store.recover()
            self._store.moment = self._moments(clock)
            self._store.start()
            self._resumed = False
            control = Control(clock)
            states = self._states = DeviceStates(clock.utc, self._device_changed)
            rig = DevicePair(devices, control, self._met, states)
            desk = PromptQueue(
                Attempts(self._store), devices.operator, control, self.folder / PROMPT, devices.person
            )
            done = sum(self._store.counts().get(s, 0) for s in ("measured", "skipped"))
            self._execution = CampaignExecution(
                control, rig, desk, Pace(clock, done, forecast), StopOrders(self._store)
            )
            return self._execution

    def _end(self, ending: State, reason: str, *, may_finish: bool) -> ExecutionOutcome:
        """Note the end of an execution; a pause may be the end of the run, if that was ordered."""
        with self._mutex:
            execution, self._execution = self._execution, None
            self._accepted = self._mover = None
            try:
                if execution is not None:
                    execution.noting.finish()
                order = open_order(self._store) if may_finish else None
                if order is not None and verdict_of(self._store)[0] is State.SUCCEEDED:
                    ending, reason = State.SUCCEEDED, end_early(self._store, order)
                else:
                    self._store.become(ending, reason)
            except StorageError as error:
                self._trouble = error.sentence
                return ExecutionOutcome(State.PAUSED, self._trouble, error)
        return ExecutionOutcome(ending, reason)

    def _check_disk(self) -> None:
        try:
            free = shutil.disk_usage(self.folder).free
        except OSError as error:
            raise StorageError(f"{self.folder}: cannot be reached ({error.strerror})") from error
        if free < LEAST_FREE_BYTES:
            raise StorageError(f"{self.folder}: less than {LEAST_FREE_BYTES // 1_000_000} MB free")

    def _moments(self, clock: Clock) -> Callable[[], EventTime]:
        """Return the function for the campaign time, which continues through a pause.

        The calendar is read once, so that its jumps do no harm.
        """
        row = self._store.campaign
        since = 0.0 if row["started_utc"] is None else clock.utc() - row["started_utc"]
        last = self._store.database.query("SELECT coalesce(max(t_s), 0) FROM event")[0][0]
        base = max(last, since * clock.time_scale) - clock.now()
        return lambda: EventTime(clock.utc(), base + clock.now())

    def age_s(self, clock: Clock) -> float:
        """Return how long ago the campaign began, s of the campaign; 0 if it has not begun."""
        started = self._store.campaign["started_utc"]
        return 0.0 if started is None else (clock.utc() - started) * clock.time_scale

    def _met(self, met: ConnectedDevice) -> None:
        """Check a connected device before anything moves, and note it.

        A warning is recorded for a robot that no program can stop: a person must be at its button.

        Raises
        ------
        OtherDevice
            It is not the device of the cell file.
        OtherIndividual
            It is not that of the record, or not the one that is needed.
        RobotInUse
            Another campaign moves the robot.
        """
        told = asdict(met.who)
        if told["calibration"] is None:
            del told["calibration"]
        self._store.add_event(
            "connected",
            role=met.role,
            **told,
            can_stop=met.can_stop,
            read_deg=met.read_deg,
            weakness=met.weakness,
        )
        check_identity(self.cell, met.role, met.who)
        Individuals(self._store).met(met.role, met.who, self._accepted)
        if met.role == "robot" and self._mover is not None:
            self._mover.met(met.who)

    def _device_changed(self, device: KnownDevice) -> None:
        with suppress(StorageError):  # the next entry meets it too, and stops the run
            self._store.add_event(
                "device_state", role=device.role, state=device.condition.value, says=device.says
            )

    def _owner_is_silent(self, lease: LeaseDeadline, control: Control) -> None:
        control.rest(f"{lease.owner} was not heard of for {lease.seconds:g} s.")
        with suppress(StorageError):  # the pause counts; if it cannot be recorded, that is the reason
            self._store.command("pause", f"watchdog of {lease.owner}")

    # -- from any thread ----------------------------------------------------------------------------------

    def pause(
        self, by: str = "", key: str | None = None, reason: str = ON_REQUEST, *, at_once: bool = False
    ) -> None:
        """End after the current reading; with `at_once`, after the current move or measurement.

        A second call with the same idempotency key `key` does nothing.
        """
        try:
            new = self._store.command("pause", by, key)
        except StorageError:
            new = True  # an order to rest is obeyed whether or not it can be noted
        if new:
            with self._mutex:
                execution = self._execution
            if execution is not None:
                execution.control.rest(reason) if at_once else execution.control.pause(reason)

    def finish(self, by: str = "", reason: str = "", key: str | None = None) -> None:
        """End as succeeded with the readings up to now: after the current reading, or at once where nothing runs.

        A run that was ended early stays as it is; a second call with the same idempotency key `key` does nothing.

        Raises
        ------
        NotResumed
            The run has ended otherwise, or has no reading that could be fitted.
        StorageError
            The record cannot be written; the run goes on.
        """
        order = note_order(self._store, by or "somebody", reason, key)
        if order is None:
            return
        with self._mutex:
            if self._execution is not None:
                self._execution.control.pause(NOT_AT_REST)
            elif not self._store.state.final:
                end_early(self._store, order)
                self._resumed, self._trouble = False, None

    def restation(self, by: str = "", reason: str = "", key: str | None = None) -> None:
        """Report that the instrument is moved: its nests are measured again.

        They are measured before the next pose, or on resuming. In a running campaign the operator is asked first to set
        the instrument up; readings taken before the order keep their world frame. A second call with the same
        idempotency key `key` does nothing.

        Raises
        ------
        NotResumed
            The campaign has ended, or its instrument has no station.
        """
        if self.cell.instrument.declared.measures_lengths:
            raise NotResumed(
                f"a {self.cell.instrument.name} has no station",
                command="restation",
                what_to_do="Where a ball on the base was moved, start a new record.",
            )
        with self._mutex:
            state, execution = self._store.state, self._execution
        if state.final:
            raise NotResumed(
                f"the campaign has {state.value}: nothing is left to be measured from a new station",
                command="restation",
                what_to_do="Start a new record; it begins with the nests.",
            )
        with self._store.changing() as db:  # both or none
            if not self._store.command("restation", by, key):
                return
            self._store.note(db, "restation", by=by, reason=reason)
        if execution is not None:  # otherwise the next execution begins with the nests
            execution.control.new_station(reason)

    def resume(self, by: str = "", key: str | None = None, accepted: DeviceAcceptance | None = None) -> None:
        """Allow the next `execute` of a paused or stopped run to move.

        `accepted` accepts another robot or instrument than the record's, for that execution; also of a run that is
        ready, which needs no leave.

        Raises
        ------
        NotResumed
            The run is in another state.
        """
        with self._store.changing() as db:  # both or none
            if not self._store.command("resume", by, key):
                return
            if accepted is not None:
                self._store.note(db, "accept_other", by=by, serial=accepted.serial, reason=accepted.reason)
        with self._mutex:
            state = self._store.state
            at_rest = state in (State.PAUSED, State.STOPPED) or (
                state is State.READY and accepted is not None
            )
            if not at_rest and not (self._trouble and not self._execution):
                raise not_resumed(state, f"a campaign that is {state.value} cannot be resumed", "resume")
            self._resumed, self._accepted = True, accepted

    def stop(self, by: str = "", key: str | None = None, reason: str = STOPPED) -> list[AcquisitionError]:
        """Halt the robot now and end the run; `reason` is why one at rest ends.

        Returns the errors of devices that could not be stopped; then use the button that they name. Nothing waits for
        the record while the robot moves (`run.orders.stop_orders`). If the record has brought a run to rest, the run
        stays paused for that reason.

        Raises
        ------
        StorageError
            Any other run at rest cannot be ended.
        """
        with self._mutex:
            execution = self._execution
            if execution is not None:
                execution.control.stop()
                execution.noting.begin(by, key)
            self._resumed = False
        if execution is not None:
            return execution.rig.halt()
        try:
            self._store.command("stop", by, key)
        except StorageError:
            if self._trouble:
                return []
            raise
        with self._mutex:
            ended = (State.STOPPED, State.SUCCEEDED, State.FAILED)
            if self._execution is None and self._store.state not in ended:
                self._store.become(State.STOPPED, reason)
                self._trouble = None
        return []

    def halt(self) -> list[AcquisitionError]:
        """Halt the robot now, in a run that was ordered to pause at once; the run is then paused.

        Returns the errors like `stop`.
        """
        with self._mutex:
            execution = self._execution
        return [] if execution is None else execution.rig.halt()

    def answer(self, prompt_id: str, answer: Answer, by: str = "", reason: str = "", typed: str = "") -> None:
        """Answer the current prompt; `reason` and `typed` are kept.

        Raises
        ------
        UnknownPrompt
            The prompt is not being asked, or the answer does not fit it.
        """
        with self._mutex:
            execution = self._execution
        if execution is None:
            raise UnknownPrompt(f"prompt {prompt_id} is not being asked", device="operator")
        execution.desk.answer(prompt_id, answer, by, reason, typed)

    @property
    def visits(self) -> Visits:
        """The visits of the plan, to order that they are measured again or left out."""
        return Visits(self._store)

    @property
    def devices(self) -> Mapping[str, KnownDevice]:
        """What is known of the devices by the last execution, by role; empty without one.

        It reads no disk, asks no device and does not wait.
        """
        states = self._states
        return {} if states is None else states.known

    @property
    def folder(self) -> Path:
        """The folder of the record."""
        return self._store.database.path.parent

    def status(self) -> RunStatus:
        """Return state, progress, prompt and last reading."""
        with self._mutex:
            execution = self._execution
        return status_of(self._store, None if execution is None else execution.pace, self._trouble)

    @property
    def changes(self) -> int:
        """Number of changes that this object has made to the record.

        It reads no disk and does not wait.
        """
        return self._store.changes

    def events(self, after: int = 0, limit: int = 1000) -> list[Event]:
        """Return the events since `after`, oldest first."""
        return self._store.events(after, limit)

    def wait(self, after: int, seconds: float) -> int:
        """Wait up to `seconds` for a version beyond `after`, and return the version."""
        return self._store.wait_beyond(after, seconds)
