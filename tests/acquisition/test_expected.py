"""Check of readings against the requested target, and of devices before the warm-up."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from scipy.spatial.transform import Rotation

from acquisition.errors import Misplaced, NothingNew, TurnedOtherwise, WronglySeated
from acquisition.record import export
from acquisition.record.store import Event
from calib.arm import forward
from calib.data import read_dataset
from drivers.errors import AcquisitionError, Busy, EnableLost, LinkLost, WrongMode
from drivers.interfaces import Answer, Identity, JointReading, PointReading, PoseReading, Prompt
from service.report.scope import scope_of
from tests.acquisition.fakes import FakeArm, FakeMeter, SeatingOperator
from tests.acquisition.stage import Stage

WARM_UP_S = 3600.0


@pytest.fixture
def stages(tmp_path: Path) -> Iterator[Callable[..., Stage]]:
    made: list[Stage] = []

    def make(**options: Any) -> Stage:
        made.append(Stage(tmp_path / str(len(made)), **options))
        return made[-1]

    yield make
    for stage in made:
        stage.run.close()


class Clumsy(SeatingOperator):
    """Operator who seats the SMR in T2 at the first prompt for T1."""

    def ask(self, prompt: Prompt) -> Answer:
        if prompt.text.startswith("Seat the SMR in T1"):
            first = not any(text == prompt.text for text in self.asked)
            self.bench.mistaken = {"T1": "T2"} if first else {}
        return super().ask(prompt)


def codes(events: list[Event]) -> list[int]:
    return [event.data["error"]["code"] for event in events if event.kind == "attempt_failed"]


def test_an_smr_in_the_wrong_nest_is_told(stages: Callable[..., Stage]) -> None:
    stage = stages(cell={"instrument__one_smr": True})
    stage.operator = Clumsy(stage.bench)
    events: list[Event] = []
    assert stage.execute(events.append).state.value == "succeeded"
    (prompt,) = [text for text in stage.operator.asked if "from where it should be" in text]
    assert (
        "sees T1 150.0 mm from where it should be, expected within 50 mm; T2 should be 0.0 mm from there"
        in prompt
    )
    assert "Seat the SMR in the target named, then confirm" in prompt
    asked_next = stage.operator.asked[stage.operator.asked.index(prompt) + 1]
    assert asked_next == "Seat the SMR in T1 and press confirm."
    assert codes(events) == [WronglySeated.code]
    assert stage.run.status().skipped == 0


def test_a_point_that_is_sent_again_is_not_the_next_one(
    stages: Callable[..., Stage], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Steps of a sweep are smaller than the tolerance of a target.

    Only its last digit shows a bridge that repeats its point.
    """
    block = {
        "kind": "sweep",
        "joint": 1,
        "at_deg": [0.0, 20.0, 20.0, 0.0, 40.0, 0.0],
        "range_deg": [0.0, 8.0],
    }
    stage = stages(block=[block | {"step_deg": 2.0, "both_ways": False, "targets": ["T1"]}])
    measure = FakeMeter.measure
    sent: list[PointReading] = []

    def frozen_once(meter: FakeMeter, target: str, **asked: Any) -> PointReading:
        seen = measure(meter, target, **asked)
        sent.append(replace(seen, xyz_mm=sent[-1].xyz_mm) if len(sent) == 5 else seen)
        return sent[-1]

    monkeypatch.setattr(FakeMeter, "measure", frozen_once)
    events: list[Event] = []
    assert stage.execute(events.append).state.value == "succeeded"
    assert codes(events) == [NothingNew.code]
    assert stage.run.status().skipped == 0
    points = [event.data["tracker_mm"] for event in events if event.kind == "reading"][3:]
    assert len(points) == 5
    assert all(one != other for one, other in pairwise(points))


def test_a_target_that_is_not_where_its_neighbours_say_is_asked_about_every_time(
    stages: Callable[..., Stage], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An SMR of another size is in one of two targets.

    The error is within the tolerance of the nominal robot, and the tracker reports a good point.
    """
    stage = stages(block=[{"kind": "poses", "count": 5, "select": "random", "targets": ["T1", "T2"]}])
    measure, seen = FakeMeter.measure, []

    def exchanged(meter: FakeMeter, target: str, **asked: Any) -> PointReading:
        reading = measure(meter, target, **asked)
        seen.append(target)
        x, y, z = reading.xyz_mm
        other = target == "T2" and seen.count("T2") > 2
        return replace(reading, xyz_mm=(x, y, z + 6.35)) if other else reading

    monkeypatch.setattr(FakeMeter, "measure", exchanged)
    stage.operator.answers = [Answer.PAUSE]
    outcome = stage.execute()
    assert (outcome.state.value, outcome.reason) == ("paused", "Paused on request.")
    assert len(stage.operator.asked) == 1
    stage.run.resume(by="anna")  # nothing of it is believed because somebody has paused
    assert stage.execute().state.value == "succeeded"
    assert len(stage.operator.asked) == 2  # in one pose the two lie across
    for asked in stage.operator.asked:
        assert re.match(
            r"T[12] and T[12] were \d+\.\d\d mm apart and are \d+\.\d\d mm now: one of them", asked
        )
    assert seen.count("T2") == 5  # nobody wanted one again
    dataset = read_dataset(export(stage.run.folder, stage.run.folder.parent / "data.csv"))
    (told,) = [text for what, text in scope_of(dataset) if what == "Targets not as far apart as at first"]
    assert told.count("T1 and T2 by -") == 2


@pytest.mark.parametrize("wrong", ["scalar last", "conjugate", "of the pose before", ""])
def test_a_body_turns_with_the_robot(
    stages: Callable[..., Stage], monkeypatch: pytest.MonkeyPatch, wrong: str
) -> None:
    """The points are good, but the turns of another convention, or of a delayed bridge, are not."""
    stage = stages()
    measure = FakeMeter.measure
    before: list[Rotation] = [Rotation.from_rotvec([0.0, 0.0, 0.0])]

    def pose(meter: FakeMeter, target: str, **asked: Any) -> PointReading:
        seen = measure(meter, target, **asked)
        bench = meter.bench
        flange = forward(bench.cell.robot.model, bench.cell.robot.model_angles([bench.where]))[0, :3, :3]
        mount = Rotation.from_euler("xyz", [10.0, 20.0, 30.0], degrees=True)
        turned = Rotation.from_matrix(bench.tracker.rotation.T) * Rotation.from_matrix(flange) * mount
        before.append(turned)
        sent: Rotation = turned
        if wrong == "conjugate":
            sent = Rotation.from_matrix(turned.as_matrix().T)
        elif wrong == "of the pose before":
            sent = before[0]
        if target.startswith("T"):
            before[:] = [turned]
        w, x, y, z = sent.as_quat(scalar_first=wrong != "scalar last")
        point = {each.name: getattr(seen, each.name) for each in fields(seen)}
        return PoseReading(**point, rot_wxyz=(w, x, y, z), rot_std_mrad=0.1, visible_tool=9, visible_base=16)

    monkeypatch.setattr(FakeMeter, "measure", pose)
    events: list[Event] = []
    state = stage.execute(events.append).state.value
    assert (state, codes(events)[:1]) == (("paused", [TurnedOtherwise.code]) if wrong else ("succeeded", []))


def test_a_beam_on_the_neighbouring_smr_is_tried_again(stages: Callable[..., Stage]) -> None:
    stage = stages()
    stage.bench.mistaken = {"T1": "T2"}
    events: list[Event] = []

    def look(event: Event) -> None:
        events.append(event)
        if event.kind == "attempt_failed":
            stage.bench.mistaken = {}

    assert stage.execute(look).state.value == "succeeded"
    assert codes(events) == [Misplaced.code]
    assert stage.run.status().skipped == 0


def test_a_target_that_is_never_where_it_should_be_is_left_out(stages: Callable[..., Stage]) -> None:
    stage = stages()
    stage.bench.mistaken = {"T1": "T3"}
    assert stage.execute().state.value == "succeeded"
    assert stage.run.status().skipped == 2  # T1 of both poses


def test_the_limit_is_the_cells(stages: Callable[..., Stage]) -> None:
    stage = stages(cell={"instrument__expected_within_mm": 200.0})
    stage.bench.mistaken = {"T1": "T2"}
    events: list[Event] = []
    assert stage.execute(events.append).state.value == "succeeded"
    assert codes(events) == []


@pytest.mark.parametrize("call", [1, 2])
@pytest.mark.parametrize(
    ("error", "asked"), [(LinkLost("no route"), 0), (Busy("another client"), 1), (WrongMode("manual"), 1)]
)
def test_a_dead_or_taken_device_is_known_before_the_warm_up(
    call: int, error: AcquisitionError, asked: int, stages: Callable[..., Stage]
) -> None:
    stage = stages(warm_up_s=WARM_UP_S)
    stage.fail(call, error)
    events: list[Event] = []
    assert stage.execute(events.append).state.value == "succeeded"
    kinds = [event.kind for event in events]
    prompt = next(i for i, event in enumerate(events) if event.kind in ("reconnect", "prompt"))
    assert prompt < kinds.index("warm_up") < kinds.index("reading")
    assert len(stage.operator.asked) == asked
    assert stage.bench.log.index("arm arm") > stage.bench.log.index("connect meter")


def test_a_device_that_stays_dead_pauses_before_the_warm_up(stages: Callable[..., Stage]) -> None:
    stage = stages(warm_up_s=WARM_UP_S)
    for call in range(1, 30):
        stage.fail(call, LinkLost("no route", device="meter"))
    began = stage.clock.now()
    outcome = stage.execute()
    assert (outcome.state.value, outcome.exit_code) == ("paused", 4)
    assert stage.clock.now() - began < 60.0
    assert "move" not in stage.bench.log
    assert not any(entry.startswith("arm") for entry in stage.bench.log)


@pytest.mark.parametrize("device", [FakeArm, FakeMeter])
def test_a_link_lost_in_the_warm_up_is_said_at_once(
    device: type, stages: Callable[..., Stage], monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(self: FakeArm | FakeMeter) -> None:
        if stage.clock.now() > WARM_UP_S / 10.0:
            raise LinkLost("no route", device=self.name)

    stage = stages(warm_up_s=WARM_UP_S)
    monkeypatch.setattr(device, "status", gone)
    assert stage.execute().state.value == "paused"
    assert stage.clock.now() < WARM_UP_S / 5.0
    assert "move" not in stage.bench.log


def test_an_open_gate_ends_no_warm_up(stages: Callable[..., Stage], monkeypatch: pytest.MonkeyPatch) -> None:
    def open_gate(self: FakeArm) -> None:
        raise EnableLost("the gate is open", device=self.name)

    stage = stages(warm_up_s=WARM_UP_S)
    monkeypatch.setattr(FakeArm, "status", open_gate)
    assert stage.execute().state.value == "succeeded"


def test_a_tracker_that_knows_no_names_is_aimed_by_hand(stages: Callable[..., Stage]) -> None:
    stage = stages(cell={"instrument__driver": "emscon"})
    assert stage.execute().state.value == "succeeded"
    assert stage.operator.asked == [
        f"Aim the tracker at the SMR in {name} and press confirm." for name in ("N1", "N2", "N3")
    ]


def test_who_the_robot_is_is_asked_again_after_a_refusal(
    stages: Callable[..., Stage], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A refusal while it is met, confirmed by a person, is no identity."""
    stage = stages()
    asked: list[str] = []

    def position(self: FakeArm) -> JointReading:
        if not asked:
            asked.append("refused")
            raise WrongMode("manual", device="arm")
        return JointReading(self.bench.where, 1e-5)

    monkeypatch.setattr(FakeArm, "position", position)
    monkeypatch.setattr(FakeArm, "identify", lambda self: Identity("ABB", "IRB 6700", "1", "1", "none"))
    outcome = stage.execute()
    assert (outcome.state.value, outcome.exit_code) == ("paused", 2)
    assert "IRB 6700" in outcome.reason
    assert "move" not in stage.bench.log
