"""The true robot, the tracker and its noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mocks.world import ROBOTS, ArmState, Session, TrackerNoise, World, noise_rms, rms_per_axis
from mocks.world.air import MEAN_C, Air
from mocks.world.scaling import rehearsal

STATE = ArmState(
    joints_deg=(10.0, 50.0, -20.0, 30.0, 40.0, 50.0),
    previous_deg=(5.0, 45.0, -15.0, 25.0, 35.0, 55.0),
    sides=(1, 1, -1, 1, 1, -1),
    t_s=1000.0,
    t_air_c=22.8,
    reading=50,
)


def test_same_seed_same_world() -> None:
    labels = ["backlash:j4", "base_shift"]
    one, two, other = World(seed=5, effects=labels), World(seed=5, effects=labels), World(seed=6)
    assert one.truth == two.truth
    assert one.true_point(STATE, "T2") == two.true_point(STATE, "T2")
    series = [[w.measured_point(STATE, "T2") for _ in range(3)] for w in (one, two)]
    assert series[0] == series[1]
    assert len(set(series[0])) == 3
    assert one.geometry != other.geometry


def test_true_point_draws_nothing() -> None:
    one, two = World(seed=5), World(seed=5)
    one.true_point(STATE, "T1")
    one.indicated_point(STATE, "T1")
    one.flange(STATE)
    assert one.measured_point(STATE, "T1") == two.measured_point(STATE, "T1")


def test_flange_carries_the_target() -> None:
    world = World(seed=2)
    p = world.flange(STATE) @ np.array([*world.targets["T2"], 1.0])
    np.testing.assert_allclose(p[:3], world.true_point(STATE, "T2"), atol=1e-9)


@pytest.mark.parametrize("robot", sorted(ROBOTS))
@pytest.mark.parametrize("seed", range(8))
def test_nominal_robot_errs_by_millimetres(robot: str, seed: int) -> None:
    world = World(robot, seed)
    errors = [math.dist(world.nominal_point(s, t), world.true_point(s, t)) for s, t in rehearsal(world)]
    assert 1.0 < np.mean(errors) < 6.0


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_axes_2_and_3_are_not_parallel(robot: str) -> None:
    world = World(robot, 4)
    nearly_parallel = [abs(math.degrees(b)) for b in world.geometry.beta if b != 0.0]
    assert len(nearly_parallel) == (1 if world.robot.convention == "mdh" else 2)
    assert all(0.01 < b < 0.05 for b in nearly_parallel)


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_true_compliances_are_near_the_published_ones(robot: str) -> None:
    world = World(robot, 4)
    assert world.compliance[0] == 0.0
    for true, published in zip(world.compliance[1:], world.robot.compliance[1:], strict=True):
        assert 0.69 < true / published < 1.31


def test_tracker_noise_along_and_across_the_beam() -> None:
    world = World(seed=3, repeatability_deg=0.0)
    true = np.array(world.true_point(STATE, "T1"))
    errors = np.array([world.measured_point(STATE, "T1") for _ in range(4000)]) - true
    beam = true - world.station
    distance = float(np.linalg.norm(beam))
    along = errors @ (beam / distance)
    across = errors - np.outer(along, beam / distance)
    assert np.std(along) == pytest.approx(0.010 + 2e-6 * distance, rel=0.05)
    assert math.sqrt(np.mean(across**2) * 1.5) == pytest.approx(0.010 + 6e-6 * distance, rel=0.05)
    assert np.abs(errors.mean(axis=0)).max() < 0.002


def test_repeatability_reaches_the_point() -> None:
    silent = TrackerNoise(0.0, 0.0, 0.0, 0.0)
    world = World(seed=3, noise=silent, repeatability_deg=0.01)
    true = np.array(world.true_point(STATE, "T3"))
    states = [replace(STATE, reading=i) for i in range(3000)]
    errors = np.array([world.measured_point(state, "T3") for state in states]) - true
    assert world.measured_point(STATE, "T3") == world.measured_point(STATE, "T3")  # it has not moved
    assert rms_per_axis(errors) == pytest.approx(math.sqrt(world.noise_variance(STATE, "T3")), rel=0.05)


def test_noise_rms_is_that_of_the_measurements() -> None:
    world = World(seed=3)
    readings = rehearsal(world)
    errors = [
        np.array(world.measured_point(replace(s, reading=20 * s.reading + i), t))
        - np.array(world.true_point(s, t))
        for s, t in readings
        for i in range(20)
    ]
    assert rms_per_axis(np.array(errors)) == pytest.approx(noise_rms(world, readings), rel=0.05)


def test_a_heavier_tool_bends_the_arm() -> None:
    light, heavy = World(seed=3), World(seed=3, tool_mass_kg=4.7)
    drop = np.array(heavy.true_point(STATE, "T1")) - np.array(light.true_point(STATE, "T1"))
    assert drop[2] < -0.05
    assert len(heavy.loads) == len(light.loads)
    assert len(World("ur5", tool_mass_kg=1.0, tool_cog_mm=(0.0, 0.0, 50.0)).loads) == 7
    with pytest.raises(ValueError, match="tool_cog_mm"):
        World("ur5", tool_mass_kg=1.0)


def test_unknown_target_is_named() -> None:
    with pytest.raises(ValueError, match="T9"):
        World().true_point(STATE, "T9")


def test_air_does_not_follow_the_clock() -> None:
    for seed in range(10):
        air = World(seed=seed).air_c
        t = np.arange(0.0, 6000.0, 20.0)
        temperature = np.array([air(v) for v in t])
        assert abs(np.corrcoef(t, temperature)[0, 1]) < 0.7
        assert np.abs(temperature - MEAN_C).max() <= 1.5
        assert np.std(temperature) > 0.5


def test_lagged_air_solves_the_first_order_equation() -> None:
    air, lag = Air((2500.0, 800.0), (0.3, 1.0)), 300.0
    body, dt = air(0.0), 0.5
    for i in range(4000):  # explicit midpoint rule as the second opinion
        middle = body + 0.5 * dt * (air(i * dt) - body) / lag
        body += dt * (air((i + 0.5) * dt) - middle) / lag
    assert air.lagged(2000.0, lag) == pytest.approx(body, abs=2e-3)
    assert air.lagged(0.0, lag) == pytest.approx(air(0.0))


def test_session_places_the_step() -> None:
    world = World(seed=1, effects=["base_shift"], session=Session(readings=40, seconds=20.0))
    at = world.effects[0].values["at_reading"]
    assert 10 <= at < 30
    before, after = replace(STATE, reading=int(at) - 1), replace(STATE, reading=int(at))
    plain = World(seed=1, session=world.session)
    assert world.true_point(before, "T1") == plain.true_point(before, "T1")
    assert world.true_point(after, "T1") != plain.true_point(after, "T1")
