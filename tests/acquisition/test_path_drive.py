"""A path that is interrupted by a pause, a stop, a crash, or a broken link.

Each move of the fake arm brings samples of both streams and ends when they were read, so the correct content of the
record is known. It is every sample up to the last motion, under an attempt that does not count. The next attempt, which
does count, goes from the first waypoint to the last.
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from acquisition import Devices, Event, ExecutionOutcome, Run, campaign_from, read_cell
from acquisition.errors import NotResumed
from acquisition.record import export_streams
from acquisition.record.streams import read_stream
from calib.data import read_noise
from drivers import Identity, JointReading, LinkLost, Sample
from tests.acquisition.fakes import Bench, Crash, FakeArm, FakeMeter, JumpingClock

CELL = Path(__file__).parents[2] / "examples" / "ur5_leica" / "cell.toml"
MIDDLE = (40.0, -105.0, 100.0, -85.0, -90.0, 0.0)
WAYPOINTS = [MIDDLE, (45.0, *MIDDLE[1:]), (50.0, *MIDDLE[1:]), (45.0, *MIDDLE[1:]), MIDDLE]
PATH = {"kind": "path", "select": "list", "targets": ["T1"], "joints_deg": [list(each) for each in WAYPOINTS]}
PER_MOVE = 7
ROLES = ("robot", "instrument")
LEGS = len(WAYPOINTS) - 1


class Streamed:
    """The samples of one device, from when its stream is opened until it is closed."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._coming: queue.Queue[Sample] | None = None
        self.sent: list[list[Sample]] = []  # of each stream

    def send(self) -> None:
        """Send samples that are read before this returns; send none if no one streams."""
        coming = self._coming
        if coming is None:
            return
        for _ in range(PER_MOVE):
            number = len(self.sent[-1])
            sample = Sample(0.01 * number, (float(number),) * self._width, number)
            self.sent[-1].append(sample)
            coming.put(sample)
        coming.join()

    @contextmanager
    def stream(self, rate_hz: float) -> Iterator[Iterator[Sample | None]]:
        self.sent.append([])
        coming = self._coming = queue.Queue()

        def samples() -> Iterator[Sample | None]:
            yield Sample(-0.01, (-1.0,) * self._width, -1)  # both flow
            while True:
                try:
                    sample = coming.get(timeout=0.01)
                except queue.Empty:
                    yield None
                else:
                    yield sample
                    coming.task_done()

        try:
            yield samples()
        finally:
            self._coming = None


class StreamingArm(FakeArm):
    """Arm whose moves bring samples of both devices.

    `at[n]` happens in the n-th move within a path.
    """

    def __init__(self, bench: Bench, streams: Sequence[Streamed], at: dict[int, Callable[[], None]]) -> None:
        super().__init__(bench)
        self._streams, self._at = streams, at
        self._moves = 0

    def stream(self, rate_hz: float) -> Any:
        self._moves = 0
        return self._streams[0].stream(rate_hz)

    def move_to(self, joints_deg: Sequence[float]) -> JointReading:
        for each in self._streams:
            each.send()
        self._moves += 1
        if self._streams[0].sent:
            self._at.pop(self._moves, lambda: None)()
        return super().move_to(joints_deg)


class StreamingMeter(FakeMeter):
    def __init__(self, bench: Bench, streamed: Streamed) -> None:
        super().__init__(bench)
        self._streamed = streamed

    def stream(self, rate_hz: float) -> Any:
        return self._streamed.stream(rate_hz)


class Scene:
    """A run of one path on fakes."""

    def __init__(self, folder: Path) -> None:
        cell = read_cell(CELL)
        self.folder = folder / "record"
        self.bench = Bench(cell)
        self.bench.who = {
            "robot": Identity("Universal Robots", "UR5", "1", "1", "none"),
            "instrument": Identity("Leica", "AT960", "1", "1", "none", True),
        }
        self.streams = (Streamed(6), Streamed(3))
        self.at: dict[int, Callable[[], None]] = {}
        campaign = campaign_from({"format": "truepose-campaign/1", "block": [PATH]}, "campaign.toml")
        self.run = Run.create(self.folder, cell, campaign, simulated=True)

    def execute(self, on_event: Callable[[Event], None] = lambda event: None) -> ExecutionOutcome:
        arm = StreamingArm(self.bench, self.streams, self.at)
        devices = Devices(arm, StreamingMeter(self.bench, self.streams[1]))
        return self.run.execute(devices, JumpingClock(), on_event)

    def attempts(self) -> list[tuple[int, str, str]]:
        """Return the attempts at the path: number, status, error."""
        rows = self.run._store.database.query(
            "SELECT id, status, error FROM attempt WHERE id IN (SELECT attempt FROM chunk) ORDER BY id"
        )
        return [(row[0], row[1], row[2] or "") for row in rows]


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    made = Scene(tmp_path)
    yield made
    made.run.close()


def holds(scene: Scene, *attempts: tuple[str, str]) -> None:
    """Assert that the record has these attempts at the path, and every sample that was sent.

    Each attempt is given by status and error.
    """
    assert [(status, error) for _, status, error in scene.attempts()] == list(attempts)
    for number, (attempt, _, _) in enumerate(scene.attempts()):
        for role, streamed in zip(ROLES, scene.streams, strict=True):
            kept = read_stream(scene.run._store, attempt, role)
            sent = [-1.0, *(sample.values[0] for sample in streamed.sent[number])]
            assert kept.values[:, 0].tolist() == sent
            assert not kept.lost.any()


def left(after: int) -> tuple[str, str]:
    """The attempt at a path that was left."""
    where = f"after waypoint {after} of {len(WAYPOINTS)}"
    return "failed", f"the robot left its path {where}, so the recordings of this path are incomplete"


def goes_on(scene: Scene, *before: tuple[str, str]) -> None:
    """Assert that only a resumed run moves, and that it drives the whole path again.

    The second drive is the one that is exported.
    """
    moved = scene.bench.log.count("move")
    with pytest.raises(NotResumed):
        scene.execute()
    assert scene.bench.log.count("move") == moved
    scene.run.resume(by="anna")
    outcome = scene.execute()
    assert outcome.state.value == "succeeded", outcome.reason
    assert scene.bench.log.count("move") == moved + 2 + LEGS
    holds(scene, *before, ("good", ""))
    _, (path,) = export_streams(scene.folder, scene.folder / "out.csv")
    assert path.complete
    assert path.samples == dict.fromkeys(ROLES, 1 + LEGS * PER_MOVE)
    assert read_noise(path.tracker.with_suffix(".toml")).range_mm > 0.0


def test_the_whole_path(scene: Scene) -> None:
    assert scene.execute().state.value == "succeeded"
    assert scene.bench.log.count("move") == 2 + LEGS
    holds(scene, ("good", ""))


@pytest.mark.parametrize("waypoint", [1, 3, LEGS])
def test_a_pause_while_it_rests_in_a_waypoint(scene: Scene, waypoint: int) -> None:
    def pause(event: Event) -> None:
        if event.kind == "waypoint" and event.data["waypoint"] == waypoint:
            scene.run.pause(by="anna")

    outcome = scene.execute(pause)
    assert (outcome.state.value, outcome.reason) == ("paused", "Paused on request.")
    assert scene.bench.log.count("move") == 2 + waypoint - 1
    holds(scene, left(waypoint))
    goes_on(scene, left(waypoint))


@pytest.mark.parametrize("at_once", [False, True], ids=["pause", "rest"])
def test_a_pause_on_the_way_ends_the_motion_in_hand_and_begins_no_other(scene: Scene, at_once: bool) -> None:
    scene.at[2] = lambda: scene.run.pause(by="anna", at_once=at_once)
    assert scene.execute().state.value == "paused"
    assert scene.bench.log.count("move") == 2 + 2
    assert scene.bench.where == pytest.approx(WAYPOINTS[2])
    ended = left(2 if at_once else 3)  # who rests looks no further, also where the robot has just arrived
    holds(scene, ended)
    goes_on(scene, ended)


def test_a_stop_on_the_way(scene: Scene) -> None:
    def stop() -> None:
        assert scene.run.stop(by="anna") == []

    scene.at[2] = stop
    assert scene.execute().state.value == "stopped"
    assert scene.bench.log.count("move") == 2 + 1  # the second one never arrived
    ((_, status, error),) = scene.attempts()
    assert status == "failed"
    holds(scene, (status, error))
    goes_on(scene, (status, error))


def test_a_stop_while_it_rests_in_a_waypoint(scene: Scene) -> None:
    def stop(event: Event) -> None:
        if event.kind == "waypoint" and event.data["waypoint"] == 2:
            scene.run.stop(by="anna")

    assert scene.execute(stop).state.value == "stopped"
    assert scene.bench.log.count("move") == 2 + 1
    holds(scene, left(2))
    goes_on(scene, left(2))


def test_a_crash_on_the_way(scene: Scene) -> None:
    def crash() -> None:
        raise Crash

    scene.at[3] = crash
    with pytest.raises(Crash):
        scene.execute()
    scene.run.close()
    scene.run = Run.open(scene.folder)  # looks at every checksum
    assert scene.run.status().state == "paused"
    holds(scene, ("died", ""))
    goes_on(scene, ("died", ""))


def test_a_link_that_breaks_on_the_way_begins_the_path_again_by_itself(scene: Scene) -> None:
    def breaks() -> None:
        raise LinkLost("reset", device="arm")

    scene.at[3] = breaks
    assert scene.execute().state.value == "succeeded"
    holds(scene, ("failed", "reset"), ("good", ""))
