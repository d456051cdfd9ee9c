"""Fakes for the sequencer: devices that log calls, a clock that jumps, a small campaign.

Faults are ordered by the number of the device call at which they happen, over all devices together.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.campaign.campaign import Campaign, campaign_from
from acquisition.campaign.plan import make_plan
from acquisition.cell.cell import Cell, cell_from
from acquisition.cell.devices import Devices
from acquisition.cell.workspace import targets_at
from acquisition.cell.world_frame import WorldFrame
from acquisition.record.store import EventTime, RecordStore
from drivers.errors import MotionStopped, NotArmed, OutOfRange, TargetNotSeen
from drivers.interfaces import (
    Answer,
    Identity,
    InstrumentStatus,
    JointReading,
    LengthReading,
    Operator,
    PointReading,
    Prompt,
    RobotStatus,
)

CELL: dict[str, Any] = {
    "format": "truepose-cell/1",
    "name": "fake",
    "robot": {
        "model": "abb-irb120",
        "driver": "abb",
        "url": "tcp://127.0.0.1:5000",
        "limits_deg": [[-90, 90], [0, 110], [-80, 70], [-150, 150], [-90, 90], [-180, 180]],
        "table_z_mm": 20.0,
    },
    "instrument": {"driver": "faro", "url": "tcp://127.0.0.1:5701", "station_mm": [2400.0, -900.0, 350.0]},
    "world": {"nests": {"N1": [0, 0, 0], "N2": [600, 0, 0], "N3": [0, 600, 0]}},
    "tool": {
        "targets": {"T1": [0, 0, 125], "T2": [75, 93.675, 215], "T3": [150, 0, 125]},
        "mass_kg": 2.7,
        "cog_mm": [50, 25, 100],
    },
}
# Six legs of 300 mm between balls on the base and on the tool of the same robot.
BALLBAR: dict[str, Any] = {
    "robot__table_z_mm": -150.0,
    "robot__limits_deg": None,
    "instrument": {"driver": "qc20w", "url": "tcp://127.0.0.1:5703", "nominal_mm": 300.0},
    "world__nests": {"B1": [486.6, 50, -100], "B2": [313.4, 150, -100], "B3": [400, -100, -100]},
    "tool__targets": {"T1": [0, 86.6, 100], "T2": [-75, -43.3, 100], "T3": [75, -43.3, 100]},
}
HEXAPOD: list[dict[str, Any]] = [{"kind": "hexapod", "set": "calibration", "count": 2}]
CAMPAIGN: dict[str, Any] = {
    "format": "truepose-campaign/1",
    "approach": {"offset_deg": -5.0, "sides": "both"},
    "settle_s": 4.0,
    "samples": 10,
    "retries": 1,
    "seed": 3,
    "block": [
        {"set": "calibration", "count": 2, "targets": ["T1", "T2"]},
        {"set": "validation", "count": 1, "targets": ["T3"]},
    ],
}


def changed(table: dict[str, Any], **values: Any) -> dict[str, Any]:
    """A copy with dotted keys (`robot__speed_mm_s`) replaced; None removes."""
    copy: dict[str, Any] = {k: dict(v) if isinstance(v, dict) else v for k, v in table.items()}
    for dotted, value in values.items():
        *path, key = dotted.split("__")
        place = copy
        for name in path:
            place = place[name]
        if value is None:
            del place[key]
        else:
            place[key] = value
    return copy


def a_cell(**values: Any) -> Cell:
    return cell_from(changed(CELL, **values), "cell.toml")


def a_campaign(**values: Any) -> Campaign:
    return campaign_from(changed(CAMPAIGN, **values), "campaign.toml")


class Crash(BaseException):
    """The process is gone."""


class JumpingClock:
    """Waits cost nothing; campaign time passes all the same."""

    time_scale = 1.0

    def __init__(self) -> None:
        self._now = 0.0
        self.calendar = 1_700_000_000.0

    def now(self) -> float:
        self._now += 0.001
        return self._now

    def utc(self) -> float:
        return self.calendar + self._now

    def wait(self, seconds: float, wake: threading.Event) -> bool:
        if wake.is_set():
            return True
        self._now += seconds
        return False


@dataclass
class Shot:
    """The truth of one measurement."""

    target: str
    joints_deg: tuple[float, ...]
    came_from_deg: tuple[float, ...]
    seated: str | None
    quiet_moves: int
    base_target: str | None = None
    spanned: tuple[str, str] | None = None


@dataclass
class Bench:
    """World of the fakes.

    `faults` gives, for the number of a device call, the event that happens in it.
    """

    cell: Cell
    faults: dict[int, Callable[[], None]] = field(default_factory=dict)
    calls: int = 0
    log: list[str] = field(default_factory=list)
    where: tuple[float, ...] = (0.0,) * 6
    came_from: tuple[float, ...] = (0.0,) * 6
    seated: str | None = None
    spanned: tuple[str, str] | None = None  # base ball and tool ball between which the ballbar is
    zeroed: int = 0
    off_deg: tuple[float, ...] = (0.0,) * 6  # by how much the joints are off
    # Moves made since anything disturbed the cell: a fault, connecting, arming, a stop, a person
    quiet_moves: int = 0
    asking: bool = False  # a person has a question before them
    who: dict[str, Identity] = field(
        default_factory=lambda: {
            "robot": Identity("ABB", "IRB 120", "1", "1", "none"),
            "instrument": Identity("fake", "meter", "1", "1", "none", True),
        }
    )
    shots: dict[float, Shot] = field(default_factory=dict)
    hidden: set[str] = field(default_factory=set)
    mistaken: dict[str, str] = field(default_factory=dict)  # target asked for -> target seen
    shift_mm: dict[str, float] = field(default_factory=dict)  # along x, of nests
    tracker: WorldFrame = field(
        default_factory=lambda: WorldFrame(
            np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([2400.0, -900.0, 350.0])
        )
    )

    def call(self, name: str) -> None:
        assert not self.asking, f"{name} before the answer"
        self.calls += 1
        self.log.append(name)
        fault = self.faults.pop(self.calls, None)
        if name.startswith(("connect", "arm")):
            self.quiet_moves = 0
        if fault is not None:
            try:
                fault()
            except BaseException:
                self.quiet_moves = 0
                raise


class FakeArm:
    """Goes anywhere at once."""

    unverified_on_hardware = False

    def __init__(self, bench: Bench, *, can_stop: bool = True) -> None:
        self.name = "arm"
        self.bench = bench
        self.can_stop = can_stop
        self.weakness = ""
        self.armed = False
        self.stops = 0

    def connect(self) -> None:
        self.armed = False
        self.bench.call("connect arm")

    def disconnect(self) -> None:
        self.armed = False

    def identify(self) -> Identity:
        return self.bench.who["robot"]

    def arm(self) -> None:
        self.bench.call("arm arm")
        self.armed = True

    def disarm(self) -> None:
        self.armed = False

    def move_to(self, joints_deg: Sequence[float]) -> JointReading:
        if not self.armed:
            raise NotArmed("not armed", device=self.name)
        assert self.bench.spanned is None, "the robot tears the ballbar off"
        try:
            self.bench.call("move")
        except BaseException:
            self.armed = False
            raise
        if not self.armed:
            raise MotionStopped("stopped", device=self.name)
        self.bench.quiet_moves += 1
        self.bench.came_from, self.bench.where = self.bench.where, tuple(joints_deg)
        return JointReading(self.bench.where, 1e-5, b"there")

    def position(self) -> JointReading:
        return JointReading(self.bench.where, 1e-5)

    def stop(self) -> None:
        self.armed = False
        self.bench.quiet_moves = 0
        self.stops += 1

    def status(self) -> RobotStatus:
        return RobotStatus("auto", True, False, False)


class FakeMeter:
    """Sees every target where the nominal robot has it."""

    unverified_on_hardware = False

    def __init__(self, bench: Bench) -> None:
        self.name = "meter"
        self.bench = bench
        self.armed = False

    def connect(self) -> None:
        self.armed = False
        self.bench.call("connect meter")

    def disconnect(self) -> None:
        self.armed = False

    def identify(self) -> Identity:
        return self.bench.who["instrument"]

    def arm(self) -> None:
        self.bench.call("arm meter")
        self.armed = True

    def disarm(self) -> None:
        self.armed = False

    def stop(self) -> None:
        self.armed = False

    def status(self) -> InstrumentStatus:
        return InstrumentStatus("READY")

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PointReading:
        bench = self.bench
        if not self.armed:
            raise NotArmed("not armed", device=self.name)
        bench.call(f"measure {target}")
        if not self.armed:
            raise MotionStopped("stopped", device=self.name)
        if target in bench.hidden:
            raise TargetNotSeen("hidden", device=self.name, raw=b"310")
        if target in bench.cell.nests:
            world = np.array(bench.cell.nests[target]) + np.array([bench.shift_mm.get(target, 0.0), 0.0, 0.0])
        else:
            names = list(bench.cell.tool.targets)
            seen = bench.mistaken.get(target, target)
            world = targets_at(bench.cell, np.array([bench.where]))[0, names.index(seen)]
        x, y, z = (float(v) for v in bench.tracker.to_tracker(world))
        if near_mm is not None:
            sent_wrong = not np.allclose(near_mm, (x, y, z), atol=0.5)
            assert not sent_wrong or target in bench.mistaken, "the beam is sent to the wrong place"
        number = float(bench.calls)
        bench.shots[number] = Shot(target, bench.where, bench.came_from, bench.seated, bench.quiet_moves)
        return PointReading(target, (x, y, z), (0.01, 0.01, 0.01), samples, number, 0.0, 22.0, raw=b"shot")


class FakeBar(FakeMeter):
    """A ballbar of 300 mm, unless it has been built to another length, that shows +-1 mm."""

    nominal_mm = 300.0

    def build(self, nominal_mm: float) -> None:
        self.bench.call(f"build {nominal_mm:g}")
        self.nominal_mm, self.armed = nominal_mm, False

    def measure(self, target: str, *, base_target: str, samples: int = 100) -> LengthReading:  # pyright: ignore
        bench = self.bench
        if not self.armed:
            raise NotArmed("not armed", device=self.name)
        bench.call(f"measure {base_target} {target}")
        if not self.armed:
            raise MotionStopped("stopped", device=self.name)
        names = list(bench.cell.tool.targets)
        tool = targets_at(bench.cell, np.array([bench.where]) + np.array(bench.off_deg))[0]
        balls = {
            name: np.array(place) + np.array([bench.shift_mm.get(name, 0.0), 0.0, 0.0])
            for name, place in bench.cell.nests.items()
        }
        balls |= {name: tool[k] for k, name in enumerate(names)}
        length = float(np.linalg.norm(balls[target] - balls[base_target]))
        number, off = float(bench.calls), length - self.nominal_mm
        if abs(off) > 1.0:
            raise OutOfRange(f"deviation of {off:+.3f} mm", device=self.name, raw=b"510")
        bench.shots[number] = Shot(
            target, bench.where, bench.came_from, None, bench.quiet_moves, base_target, bench.spanned
        )
        return LengthReading(
            target, base_target, length, 0.0005, off, 0.0, samples, number, 0.0, 22.0, raw=b"shot"
        )

    def zero(self) -> float:
        if not self.armed:
            raise NotArmed("not armed", device=self.name)
        self.bench.call("zero")
        self.bench.zeroed += 1
        return 0.001


class SeatingOperator:
    """Operator who follows the prompt and gives the listed answers, then CONFIRM."""

    def __init__(self, bench: Bench, answers: Sequence[Answer] = ()) -> None:
        self.bench = bench
        self.answers = list(answers)
        self.asked: list[str] = []

    def ask(self, prompt: Prompt) -> Answer:
        self.bench.asking, self.bench.quiet_moves = True, 0
        self.asked.append(prompt.text)
        answer = self.answers.pop(0) if self.answers else Answer.CONFIRM
        if answer not in prompt.expects:
            answer = Answer.CONFIRM
        if prompt.text.startswith("Seat the SMR in ") and answer is Answer.CONFIRM:
            self.bench.seated = prompt.text.split()[4]
        if answer is Answer.CONFIRM and prompt.text.startswith("Attach the ballbar between "):
            words = prompt.text.split()
            self.bench.spanned = words[4], words[6]
        if answer is Answer.CONFIRM and prompt.text.startswith(
            ("Take the ballbar off", "Put the ballbar into")
        ):
            self.bench.spanned = None
        self.bench.asking = False
        return answer


def devices_of(bench: Bench, operator: Operator | None = None, *, can_stop: bool = True) -> Devices:
    meter = FakeBar(bench) if bench.cell.instrument.declared.measures_lengths else FakeMeter(bench)
    return Devices(FakeArm(bench, can_stop=can_stop), meter, operator)


def new_store(folder: Path) -> RecordStore:
    """A record of `a_campaign` in `a_cell`, whose clock ticks a second a look."""
    cell, campaign = a_cell(), a_campaign()
    store = RecordStore.create(
        folder, "test", cell.source, campaign.source, make_plan(cell, campaign), simulated=True
    )
    ticks = itertools.count(1)
    store.moment = lambda: EventTime(1e9, float(next(ticks)))
    return store
