"""The sequencer: nests, then every visit of the plan, one durable reading at a time.

A visit is approach, settle, measure. Robot and instrument are connected before the warm-up, but not armed, so that a
device that does not answer, or that belongs to another cell, is reported before the wait.

Its reaction to an error depends on the class (`drivers.errors`):

    LinkError      connect, arm and approach again; after `LINK_TRIES` in a row: pause
    Unmeasurable   approach again and retry; then put off, come back at the end, then skip
    Refused        ask the operator: confirm tries again, skip leaves the reading out
    SafetyStop, StorageError, NoOperator and all others: pause

Any interruption voids the approach, also a prompt, for which people walk up to the robot. A reading is only taken
after an arrival with nothing in between, and only kept if the robot has not moved since. A ballbar is put on while the
robot is in the pose, and the robot stays there for all its distances. Legs outside the stroke of the bar are deferred
to a second stage, for which the robot is calibrated from those within (`run.ballbar.second_stage`). A redo puts the
last reading aside and measures it again at once. If the calendar steps, the run pauses: the times of the record come
from the steady clock, which does not count while a computer sleeps. On resuming they catch up with the calendar and
never go back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from acquisition.campaign.blocks.ballbar_geometry import BallbarGeometryBlock
from acquisition.campaign.campaign import Campaign
from acquisition.cell.cell import Bar, Cell, bar_for, bars_of
from acquisition.cell.transit import Transit
from acquisition.errors import NothingNew, NothingWhereItShouldBe, OtherBalls, WronglySeated
from acquisition.record.attempts import Attempts
from acquisition.record.store import PlannedReading, RecordStore
from acquisition.run.adaptive import AdaptiveSelection
from acquisition.run.arrivals import Arrival, Arrivals
from acquisition.run.ballbar.distances import BallbarChecks
from acquisition.run.ballbar.second_stage import SecondStage
from acquisition.run.ballbar.touch_replanning import Placing
from acquisition.run.checks.attitudes import Attitudes
from acquisition.run.checks.calendar import Calendar
from acquisition.run.checks.gates import Gates, Zeroing
from acquisition.run.checks.nests import Nests
from acquisition.run.checks.repeated_point import Expectation, RepeatedPointCheck, as_planned
from acquisition.run.checks.target_distances import TargetDistanceCheck
from acquisition.run.clock import Clock
from acquisition.run.duration import Begin
from acquisition.run.orders.control import ON_REQUEST, Control, Stopping
from acquisition.run.prompts.manual_steps import ManualSteps
from acquisition.run.prompts.picture import PromptPicture
from acquisition.run.prompts.prompt_queue import PromptAnswer, PromptQueue
from acquisition.run.prompts.touches import Touches
from acquisition.run.rig.path import PathDrive
from acquisition.run.rig.rig import DevicePair
from drivers.errors import AcquisitionError, LeftOut, LinkError, OutOfRange, Refused, Unmeasurable
from drivers.interfaces import Answer, LengthReading, PointReading, Reading, TypedEntry

LINK_TRIES = 5
FIRST_BACK_OFF_S = 0.1  # on the wall; doubles with every try
LOOK_EVERY_S = 5.0  # on the wall, at devices in a long wait
GIVEN_UP_IN_A_ROW = 10  # then the poses are not the cause: a person has to check
# Before any target was measured, the arm may be another than the one used for clearance. An error that an instrument
# repeats is not caused by the pose either.
GIVEN_UP_AT_FIRST = 3


class Sequencer:
    """The sequencer of one execution of a record's plan."""

    def __init__(
        self,
        store: RecordStore,
        cell: Cell,
        campaign: Campaign,
        rig: DevicePair,
        control: Control,
        desk: PromptQueue,
        clock: Clock,
        begin: Begin,
    ) -> None:
        self._store = store
        self._attempts = Attempts(store)
        self._cell = cell
        self._campaign = campaign
        self._rig = rig
        self._control = control
        self._desk = desk
        self._clock = clock
        self._calendar = Calendar(clock)
        zero = Zeroing(self._needs_another_bar, self._zero)
        self._gates = Gates(store, campaign, self._wait, control, self._ask, self._measure_nests, zero)
        self._hands = ManualSteps(cell, self._answer, lambda nest: self._nests.near_mm(nest) is None)
        self._touches = Touches(cell, self._attempts, rig, self._answer)
        self._placing = Placing(store, cell, campaign, self._consult)
        rig.attend(self._by_person)
        transit, by_hand = Transit(self._placing.cell()), cell.robot.declared.by_hand
        self._arrivals = Arrivals(store, campaign, rig, control, transit, by_hand=by_hand)
        self._path = PathDrive(store, campaign, rig, control, transit)
        self._checks, self._anew, self._attitudes = (
            BallbarChecks(store, cell),
            RepeatedPointCheck(),
            Attitudes(cell),
        )
        self._companions = TargetDistanceCheck(store)
        self._adaptive = AdaptiveSelection(store, campaign, begin, control, clock)
        self._second_stage = SecondStage(store, cell, campaign, self._placing.cell)
        self._nests = Nests(store, cell, lambda nest: self._try(nest, last=True), self._consult)
        self._arrival: Arrival | None = None
        # The bar that is built, if it is always that of the legs; otherwise unknown until it is built.
        one = not any(isinstance(block, BallbarGeometryBlock) for block in campaign.blocks)
        self._bar = bars_of(cell)[0] if one and cell.instrument.declared.measures_lengths else None
        self._reason = ""  # of the last answer
        self._last: tuple[int, ...] = ()  # planned reading of a pose that was measured last
        self._link_faults = 0  # in a row, as the three below
        self._tries = 0
        self._refusals = 0
        self._given_up = 0
        self._seen = False  # whether any target was found about where the robot file has it

    def run(self) -> None:
        """Take the missing readings.

        Raises
        ------
        Pausing, Stopping
            The run must pause or stop.
        AcquisitionError
            An error pauses the campaign.
        """
        self._calendar.look()
        self._insist(self._rig.meet)
        self._warm_up()
        self._measure_nests("resumed: is the instrument still where it was?")
        self._gates.ask_about_nests()
        # The next reading is read from the record every time: one may be deferred, or requested again.
        while self._store.left("planned") or self._adaptive.extend() or self._store.left("deferred"):
            while left := self._store.left("planned"):
                self._adaptive.look_ahead()
                self._next(left[0], last=False)
            if self._adaptive.extend():
                continue
            self._second_stage.plan()
            while left := self._store.left("planned") or self._store.left("deferred"):
                self._next(left[0], last=True)
            self._gates.check_nests_at_end()

    # -- before the first pose ----------------------------------------------------------------------------

    def _measure_nests(self, reason: str, *, aim: bool = True) -> None:
        self._arrival = None
        self._nests.measure(reason, aim=aim)

    def _warm_up(self) -> None:
        """Wait for the warm-up, in every execution.

        A cell that is resumed next morning has cooled down.
        """
        if self._campaign.warm_up_s > 0.0:
            now_s = self._store.moment().t_s or 0.0
            self._store.add_event("warm_up", until_t_s=now_s + self._campaign.warm_up_s)
            self._wait(self._campaign.warm_up_s)

    def _wait(self, seconds: float) -> None:
        """Wait for `seconds` of campaign time in which nothing moves.

        A device that fails meanwhile is noticed at once, not at the end.
        """
        end = self._clock.now() + seconds
        while (left := end - self._clock.now()) > 0.0:
            self._control.wait(min(left, LOOK_EVERY_S * self._clock.time_scale))
            self._insist(self._rig.look)

    # -- one reading --------------------------------------------------------------------------------------

    def _next(self, planned: PlannedReading, *, last: bool) -> None:
        """Make one try, unless others were planned before it; the next one is then requested again."""
        self._control.check()
        if not self._touches.wanted(planned):
            self._touches.leave()
        if planned.visit.kind == "pose" and self._arrival is None and self._placing.look():
            self._arrivals.transit = Transit(self._placing.cell())  # by where the cups were touched
        elif self._touches.wanted(planned) or self._gates.open_for(planned):
            self._try(planned, last=last)
        else:
            self._arrival = None

    def _try(self, planned: PlannedReading, *, last: bool) -> None:
        """Make one try at a reading; with `last`, skip it for good if it is not obtained."""
        self._control.check()
        self._calendar.look()
        arrival, self._arrival = self._arrival, None  # only what ends well below leaves the approach valid
        try:
            if self._touches.wanted(planned):
                if self._by_hand(planned, self._touches.take) is Answer.CONFIRM:
                    self._last = (planned.id,)
                    self._link_faults = self._given_up = self._tries = self._refusals = 0
                return
            if self._by_hand(planned, self._hands.seat) is not Answer.CONFIRM:
                return
            if self._by_hand(planned, self._hands.aim) is not Answer.CONFIRM:
                return
            self._rig.make_ready()
            attempt = None
            if planned.visit.kind == "pose" and (arrival is None or arrival.visit != planned.visit.number):
                if self._by_hand(planned, self._hands.free) is not Answer.CONFIRM:
                    return
                arrival, attempt = self._arrivals.go(planned)
            answer = self._by_hand(planned, self._hands.span)
            if answer is not Answer.CONFIRM:
                self._arrival = arrival if answer is Answer.SKIP else None
                return
            if planned.base_target is not None and arrival is not None:
                self._arrivals.check_not_displaced(arrival)  # while the bar was put on
            if attempt is None:
                attempt = self._attempts.begin_reading(planned, None if arrival is None else arrival.attempt)
            doubt = self._measure(planned, attempt, arrival)
        except LeftOut as error:
            if planned.visit.counted and not error.again:
                self._done_with(planned, "skipped", self._reason or "by the operator")
        except LinkError as error:
            self._control.check_stop()
            self._after_link_error(error)
        except Unmeasurable as error:
            out_of_stroke = planned.base_target is not None and isinstance(error, OutOfRange)
            if planned.base_target is not None:
                self._arrival = arrival  # the arm is at rest, the next distance is measured there
            self._tries += 1
            if out_of_stroke or self._tries > self._campaign.retries:
                self._give_up(planned, error, last=last)
        except Refused as error:
            if isinstance(error, WronglySeated | OtherBalls):
                self._hands.doubt()
            if self._refuse_again(error) is Answer.SKIP:
                self._give_up(planned, error, last=True)
        else:
            self._arrival = None if planned.visit.waypoints else arrival  # a path ends elsewhere
            self._link_faults = self._given_up = self._tries = self._refusals = 0
            if doubt is not None:
                self._ask(doubt, pause=True)

    def _measure(self, planned: PlannedReading, attempt: int, arrival: Arrival | None) -> str | None:
        """Measure and keep a reading.

        Returns a question to a person if it contradicts earlier readings, or None.
        """
        try:
            if planned.base_target is not None:
                reading: Reading = self._length(planned, planned.base_target)
            else:
                reading = self._point(planned, arrival)
            if planned.visit.waypoints:
                self._path.drive(planned, attempt)
            elif arrival is not None:
                self._arrivals.check_not_displaced(arrival)  # while it settled and was measured
        except AcquisitionError as error:
            self._attempts.failed(attempt, error)
            raise
        point = None
        if planned.visit.counted and self._nests.world is not None and isinstance(reading, PointReading):
            seen = self._nests.world.to_world(reading.xyz_mm)
            point = as_planned(self._cell, planned, self._arrivals.stands(planned, arrival), seen)
        self._attempts.measured(attempt, planned, reading, self._nests.world, point)
        if planned.visit.counted:
            self._last = (planned.id,)
            self._seen = True
            self._gates.measured(planned, point)
            if planned.visit.between_balls:
                return self._checks.moved(planned)
            if isinstance(reading, PointReading):
                world = self._nests.world  # its own for each station of the instrument
                at = reading.xyz_mm if world is None else world.to_world(reading.xyz_mm)
                return self._companions.changed(planned, reading.target, at)
        return None

    def _length(self, planned: PlannedReading, base_target: str) -> LengthReading:
        """Measure the length of a leg.

        Raises
        ------
        OtherBalls
            The length cannot be that of the leg.
        """
        try:
            reading = self._rig.measure_length(planned.target, base_target, self._campaign.samples)
        except OutOfRange:
            self._checks.refuse_others(planned, None)
            raise
        self._anew.refuse_length_again(reading, planned)
        self._checks.battery(reading)
        self._checks.refuse_others(planned, reading.length_mm)
        return reading

    def _point(self, planned: PlannedReading, arrival: Arrival | None) -> PointReading:
        """Measure the point of a target.

        Raises
        ------
        Misplaced, WronglySeated, TurnedOtherwise
            The point or its orientation cannot be that of the target.
        """
        if self._nests.world is None or arrival is None:
            return self._rig.measure(planned.target, self._campaign.samples, self._nests.near_mm(planned))
        stands = self._arrivals.stands(planned, arrival)
        expected = Expectation(self._cell, planned, stands)
        near = tuple(float(x) for x in self._nests.world.to_tracker(expected.world_mm))
        reading = self._rig.measure(planned.target, self._campaign.samples, near)
        expected.refuse_another(reading, self._nests.world.to_world(reading.xyz_mm))
        self._anew.refuse_repeated_point(reading, expected.world_mm)
        self._attitudes.refuse_another(reading, self._nests.world, stands)
        return reading

    def _by_hand(self, planned: PlannedReading, do: Callable[[PlannedReading], Answer]) -> Answer:
        """Have a person do the manual step of a reading, and return the answer.

        CONFIRM means that it is done; a skipped reading is left out.
        """
        answer = do(planned)
        if answer is Answer.SKIP and planned.visit.counted:
            self._done_with(planned, "skipped", self._reason or "by the operator")
        return answer

    def _zero(self, planned: PlannedReading) -> bool:
        """Read the zero of the bar that a reading needs; it applies to every later reading.

        Returns whether the reading may be tried. A person who skips this keeps the old zero. Another bar has none; its
        reading is then left out.
        """
        bar = self._bar_of(planned)
        another = bar != self._bar
        if self._hands.zero(bar if another else None) is not Answer.CONFIRM:
            if another:
                self._done_with(planned, "skipped", self._reason or "the ballbar was not built for it")
            return not another
        if another:
            self._rig.build(bar.length_mm)
            self._bar = bar

        def read() -> None:
            self._rig.make_ready()
            self._store.add_event("zeroed", zero_mm=self._rig.zero(), bar_mm=bar.length_mm)

        self._insist(read)
        return True

    def _bar_of(self, planned: PlannedReading) -> Bar:
        return bar_for(self._cell, planned.target, planned.base_target or "")

    def _needs_another_bar(self, planned: PlannedReading) -> bool:
        return planned.base_target is not None and self._bar_of(planned) != self._bar

    # -- reactions ----------------------------------------------------------------------------------------

    def _insist(self, act: Callable[[], None]) -> None:
        """Repeat an act until it is done, or a person skips it.

        Errors are those of a reading.
        """
        while True:
            self._control.check()
            try:
                act()
            except LinkError as error:
                self._control.check_stop()
                self._after_link_error(error)
            except (Refused, Unmeasurable) as error:
                if self._refuse_again(error) is Answer.SKIP:
                    return
            else:
                self._link_faults = self._refusals = 0
                return

    def _after_link_error(self, error: LinkError) -> None:
        self._link_faults += 1
        if self._rig.lost_in_move or self._link_faults > LINK_TRIES:
            raise error
        back_off_s = FIRST_BACK_OFF_S * 2.0 ** (self._link_faults - 1)
        self._store.add_event("reconnect", attempt=self._link_faults, error=error.as_dict())
        self._control.wait(back_off_s * self._clock.time_scale)

    def _refuse_again(self, error: AcquisitionError) -> Answer:
        """Ask about a refusal, or raise its error after too many repetitions."""
        self._control.check_stop()  # a stop makes devices refuse
        self._refusals += 1
        if self._refusals > self._campaign.retries + 1:
            raise error
        return self._consult(error)

    def _give_up(self, planned: PlannedReading, error: AcquisitionError, *, last: bool) -> None:
        if not planned.visit.counted:
            raise error  # without its nests a campaign has no world frame
        self._done_with(planned, "skipped" if last else "deferred", error.message)
        self._given_up += 1
        unseen = planned.base_target is None and not self._seen
        soon = unseen or isinstance(error, NothingNew)
        if self._given_up >= (GIVEN_UP_AT_FIRST if soon else GIVEN_UP_IN_A_ROW):
            tries, self._given_up = self._given_up, 0
            self._seen = True  # by a person who says so
            self._consult(
                NothingWhereItShouldBe(f"none of the first {tries} readings succeeded: {error.message}")
                if unseen
                else error
            )

    def _done_with(self, planned: PlannedReading, status: str, reason: str) -> None:
        self._store.mark(planned.id, status, reason)
        self._tries = self._refusals = 0

    def _consult(self, error: AcquisitionError) -> Answer:
        """Ask whether to continue.

        Raises
        ------
        Stopping
            The answer is abort.
        NoOperator, Pausing
            There is no answer.
        """
        return self._ask(error.sentence)

    def _answer(self, text: str, picture: PromptPicture) -> Answer:
        return self._ask(text, about=picture)

    def _ask(
        self,
        text: str,
        again: Sequence[int] = (),
        about: PromptPicture | str | None = None,
        *,
        pause: bool = False,
    ) -> Answer:
        """Ask a person, carry out a redo, and return the answer.

        Raises
        ------
        Stopping
            The answer is abort.
        NoOperator, Pausing
            There is no answer.
        """
        self._arrival = None
        self._rig.may_have_moved()
        again, picture = (
            again or self._last,
            about if isinstance(about, PromptPicture) else PromptPicture(about),
        )
        return self._obeyed(self._desk.ask(text, picture, redo=bool(again), pause=pause), again).answer

    def _obeyed(self, given: PromptAnswer, again: Sequence[int]) -> PromptAnswer:
        """Carry out the order in an answer; a redo measures the readings `again`.

        Raises
        ------
        Stopping
            The answer is abort.
        Pausing
            The answer is pause.
        """
        if given.answer is Answer.PAUSE:
            self._control.pause(given.reason or ON_REQUEST)
            self._control.check()
        if given.answer is Answer.ABORT:
            self._control.stop()
            raise Stopping
        if given.answer is Answer.REDO and again:
            self._store.measure_again(again, given.reason or "by the operator")
            self._last = ()
            self._hands.doubt()  # a person checks before the robot goes back there
        self._reason = given.reason
        return given

    def _by_person(self, text: str, entry: TypedEntry, picture: str) -> str:
        """Return the entry that a person types when a manual device asks for it.

        It counts as an act of the device, so the approach of the pose stays valid.

        Raises
        ------
        LeftOut
            The answer is skip or redo.
        Stopping
            The answer is abort.
        NoOperator, Pausing
            There is no answer.
        """
        given = self._desk.ask(text, PromptPicture(picture), redo=bool(self._last), entry=entry)
        self._obeyed(given, self._last)
        if given.answer is not Answer.CONFIRM:
            again = given.answer is Answer.REDO
            raise LeftOut(given.reason or "by the operator", again=again, device="operator")
        return given.typed
