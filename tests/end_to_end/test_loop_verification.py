"""Judgement of a landing, without a cell: expected temperature, floor, kinds of rows, frame.

These would catch: a trend of the wrong sign or length, and a floor that counts one axis only. They would also catch
mixed corrected and uncorrected rows, and an unreported move of the instrument between the campaigns.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from acquisition import campaign_from, read_cell
from acquisition.campaign import make_plan
from acquisition.cell.world_frame import WorldFrame
from acquisition.errors import RecordError
from acquisition.loop.loop import APPROACH_DEG, campaign_of, clear
from acquisition.loop.rehearsal import campaign_table
from acquisition.record import RecordStore
from acquisition.record.attempts import Attempts
from acquisition.record.store import EventTime
from acquisition.record.verification import (
    JudgedLandings,
    Landings,
    expected_temperature,
    first_reading_s,
    frame_holds,
    landed_points,
    nominal_points,
    read_landings,
    verification_of,
    world_of,
)
from calib import forward
from calib.effects.instrument import drift_translation
from calib.model import ModelStructure
from drivers import JointReading, PointReading
from tests.end_to_end.simulated import EXAMPLE

CELL = read_cell(EXAMPLE / "cell.toml")
CAMPAIGN = campaign_from(campaign_table(1, 4, 1), "test")


def record_of(folder: Path, air: list[float]) -> Path:
    """Write a record with a reading every 10 s at these air temperatures; only its times matter."""
    visits = make_plan(CELL, CAMPAIGN)
    store = RecordStore.create(folder, "test", CELL.source, CAMPAIGN.source, visits, simulated=True)
    attempts, now = Attempts(store), 0.0

    def moment() -> EventTime:
        return EventTime(1000.0 + now, now)

    store.moment = moment
    store.start()
    plan = [planned for planned in store.plan() if planned.visit.kind == "pose"]
    for planned, celsius in zip(plan, air, strict=False):
        arrival = attempts.begin_arrival(planned.visit)
        attempts.arrived(arrival, JointReading(planned.visit.joints_deg, 0.01))
        reading = attempts.begin_reading(planned, arrival)
        now += 10.0
        attempts.measured(reading, planned, reading_at(celsius), WorldFrame(np.eye(3), np.zeros(3)))
    store.close()
    return folder


def reading_at(celsius: float) -> PointReading:
    return PointReading("T1", (1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 1, 0.0, 0.0, t_air_c=celsius)


def test_temperature_follows_its_trend(tmp_path: Path) -> None:
    record = record_of(tmp_path / "r", [20.0, 20.0, 20.0, 20.0, 20.2, 20.4, 20.6])
    assert expected_temperature(record, 70.0, 25.0) == pytest.approx(20.6)
    assert expected_temperature(record, 90.0, 25.0) == pytest.approx(21.0)
    assert expected_temperature(record, 90.0, 5.0) == pytest.approx(20.6)  # one reading is no trend
    assert expected_temperature(record, 9000.0, 25.0) < 21.5  # nor is one believed for hours
    assert first_reading_s(record) == pytest.approx(10.0)


def test_without_temperature_none_is_expected(tmp_path: Path) -> None:
    assert np.isnan(expected_temperature(record_of(tmp_path / "r", []), 70.0, 25.0))


def test_a_record_without_readings_is_refused(tmp_path: Path) -> None:
    record = record_of(tmp_path / "r", [])
    with pytest.raises(RecordError, match="no reading"):
        read_landings(record)
    with pytest.raises(RecordError, match="nests"):
        world_of(record)


def judged(
    off: list[float], corrected: list[bool], floor: float, nests: float, goals: list[float]
) -> JudgedLandings:
    """Landings that are off along x."""
    n = len(off)
    errors = np.zeros((n, 3))
    errors[:, 0] = off
    return JudgedLandings(
        errors=errors,
        corrected=np.array(corrected),
        floor_mm=np.full(n, floor),
        off_mm=nests,
        u_mm=np.full(n, 0.1),
        goals_deg=np.array(goals)[:, None],
        wanted=np.zeros((n, 3)),
        target=("T1",) * n,
    )


def test_corrected_and_uncorrected_rows_are_told_apart() -> None:
    first = judged([0.1, 3.0, 0.2], [True, False, True], 0.1, 0.02, goals=[1.0, 1.0, 2.0])
    second = judged([0.3], [True], 0.2, 0.05, goals=[3.0])
    found = verification_of([first, second], 2, ["why"], "from below")
    assert found.uncorrected is not None
    assert (found.uncorrected.n, found.uncorrected.max) == (1, 3.0)
    assert found.verified.rms == pytest.approx(np.sqrt((0.01 + 0.04 + 0.09) / 3.0))
    assert found.floor_mm == pytest.approx(np.sqrt((0.01 + 0.01 + 0.04) / 3.0))
    assert found.ratio == pytest.approx(found.verified.rms / found.floor_mm)
    assert found.nests_off_mm == 0.05
    assert [(each.pose, each.corrected) for each in found.landings] == [
        (1, True),
        (1, False),
        (2, True),
        (3, True),
    ]
    assert found.landings[1].error_mm == (3.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="no corrected target"):
        verification_of([judged([1.0], [False], 1.0, 0.0, goals=[1.0])], 0, [], "")


def test_nominal_points_are_those_of_the_nominal_robot() -> None:
    joints = np.array([[10.0, 20.0, -30.0, 40.0, 50.0, 60.0], [0.0, 10.0, 20.0, 5.0, 30.0, -60.0]])
    poses = forward(CELL.robot.model, np.radians(joints))
    points = nominal_points(CELL, joints, ["T2", "T1"])
    for pose, name, point in zip(poses, ("T2", "T1"), points, strict=True):
        np.testing.assert_allclose(point, (pose @ [*CELL.tool.targets[name], 1.0])[:3], atol=1e-9)


def test_the_second_campaign_drives_both_from_the_stated_side() -> None:
    wanted = np.array([[10.0, 20.0, -30.0, 40.0, 50.0, 60.0]])
    campaign = campaign_of(CAMPAIGN, wanted + 0.1, wanted)
    visits = [visit for visit in make_plan(CELL, campaign) if visit.kind == "pose"]
    assert [visit.joints_deg for visit in visits] == [tuple(np.round(wanted[0] + 0.1, 4)), tuple(wanted[0])]
    for visit in visits:
        assert visit.sides == (1,) * 6
        np.testing.assert_allclose(np.subtract(visit.approach_deg, visit.joints_deg), APPROACH_DEG)
    assert json.loads(json.dumps([visit.set for visit in visits])) == ["validation", "validation"]


def test_targets_near_the_table_are_not_clear() -> None:
    low = [0.0, 110.0, 60.0, 0.0, 0.0, 0.0]
    high = [0.0, 20.0, 0.0, 0.0, 30.0, 0.0]
    assert list(clear(CELL, np.array([low, high]))) == [False, True]


def test_an_instrument_that_was_moved_is_tied_to_its_nests() -> None:
    """Only the nests show the move: the second campaign's frame counts, no instrument model."""
    here, moved = WorldFrame(np.eye(3), np.zeros(3)), WorldFrame(np.eye(3), np.array([0.0, 0.0, 5.0]))
    nests = {name: np.array(point) - moved.origin for name, point in CELL.nests.items()}
    points = np.array([[300.0, 100.0, 395.0]])
    driven = np.array([[10.0, 20.0, -30.0, 40.0, 50.0, 60.0]])
    joints, previous = np.radians(driven), np.radians(driven + APPROACH_DEG)
    landings = Landings(driven, joints, previous, ("T1",), points, np.ones(1), np.full(1, 22.0), moved, nests)
    model = ModelStructure(CELL.robot.model, (drift_translation(),), {"main": dict(CELL.tool.targets)})
    drifting = np.array([1.0, 0.0, 0.0])  # mm/s
    assert not frame_holds(landings, here, CELL.nests, {})
    assert frame_holds(landings, moved, CELL.nests, {})
    at = landed_points(landings, here, model, drifting, 9.0, holds=False)
    np.testing.assert_allclose(at, [[300.0, 100.0, 400.0]])
    still = landed_points(landings, here, model, drifting, 9.0, holds=True)
    np.testing.assert_allclose(still, [[290.0, 100.0, 395.0]], atol=1e-9)  # ten seconds of drift taken out
