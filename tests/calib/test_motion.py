"""Test the alignment of a moving robot.

These would catch: wrong clocks, a jump that is missed or invented, samples taken across a gap, stationary intervals
or waypoints miscounted, and one waypoint on both sides of a hold-out. They would also catch an uncertainty that is
not that of the rows, and a stream that cannot be aligned but is.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from calib import DataError, identify, load_robot, read_dataset
from calib.data import Noise
from calib.fit import errors_on
from calib.motion import Aligned, JointStream, Origin, PointStream, align, by_speed, data_set, standstills
from calib.motion.poses import scatter
from tests.calib.bending import gears
from tests.calib.moving import TOOL, Moving, simulate, tool_points

ROBOT = load_robot("ur5")
FINE = Noise("isotropic", 1e-4)
ORIGIN = Origin("ur5", "none", "leica-at960", TOOL, tool_known=False, remark="simulated")


def streams(moving: Moving) -> tuple[JointStream, PointStream]:
    return (
        JointStream(moving.robot_time, moving.joints),
        PointStream(moving.tracker_time, moving.points),
    )


def aligned_of(moving: Moving) -> Aligned:
    return align(ROBOT, *streams(moving), TOOL)


@cache
def short(seed: int = 1, **options: object) -> Moving:
    """A quicker recording: 16 waypoints in 160 s, 50 Hz and 10 Hz."""
    return simulate(seed, **{"legs": 16, "duration": 160.0, "robot_hz": 50.0} | options)  # pyright: ignore[reportArgumentType]


@cache
def aligned_short() -> Aligned:
    return aligned_of(short())


@pytest.fixture(scope="module")
def paper() -> tuple[Moving, Aligned]:
    """The set-up of the paper."""
    moving = simulate(1)
    return moving, aligned_of(moving)


def test_the_clocks_are_found(paper: tuple[Moving, Aligned]) -> None:
    moving, found = paper
    offset, rate = found.clocks.offset - moving.offset, found.clocks.rate - moving.rate
    assert abs(offset) < 1e-3
    assert abs(rate) < 2e-6
    # and are as good as they say: five standard errors
    assert abs(offset) < 5.0 * found.u_offset < 0.2e-3
    assert abs(rate) < 5.0 * found.u_rate < 1e-6
    assert np.isinf(found.clocks.step_at)
    assert found.warnings == ()
    assert (found.weight == 0.0).sum() <= 2


def test_fitted_and_nominal_arm_are_said_apart(paper: tuple[Moving, Aligned]) -> None:
    moving, found = paper
    np.testing.assert_array_equal(found.used, True)
    assert np.sqrt(np.mean(found.error**2)) == pytest.approx(0.02, rel=0.1)  # the noise
    assert np.sqrt(np.mean(found.nominal**2)) > 0.1
    np.testing.assert_array_equal(found.point, moving.points)


# Early in the recording the fit follows what comes after, and what came before looks like gross errors.
@pytest.mark.parametrize(("at", "size"), [(100.0, 0.010), (250.0, -6.5)])
def test_a_clock_that_jumps_is_noticed(at: float, size: float) -> None:
    moving = simulate(2, jump=(at, size))
    found = aligned_of(moving)
    assert found.clocks.step == pytest.approx(size * (1.0 + moving.rate), abs=min(0.5e-3, 5.0 * found.u_step))
    assert found.clocks.robot_time(np.array([found.clocks.step_at]))[0] == pytest.approx(at, abs=3.0)
    assert found.clocks.offset == pytest.approx(moving.offset, abs=1e-3)
    assert (found.weight == 0.0).sum() <= 5


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_arm_that_bends_and_has_play_shifts_no_clock(seed: int) -> None:
    """An arm that bends and has play shifts no clock.

    With few slow waypoints and geometry alone, the offset was up to 5 ms wrong, and a clock was reported to jump.
    Seven moves show little of the robot's repeatability, so the rate is known to 4 ppm only.
    """
    worn = partial(gears, waves_rad=2e-4, play_rad=1e-4)
    moving = simulate(seed, legs=8, duration=300.0, rest=5.0, robot_hz=50.0, gears_of=worn)
    found = aligned_of(moving)
    assert np.isinf(found.clocks.step_at)
    assert found.warnings == ()
    assert abs(found.clocks.offset - moving.offset) < 3.0 * found.u_offset < 1e-3
    assert abs(found.clocks.rate - moving.rate) < 3.0 * found.u_rate < 12e-6


def test_what_a_short_recording_does_not_show_of_the_arm_is_in_the_uncertainty() -> None:
    """Six waypoints do not determine play and gears, so the uncertainty includes them.

    Without their usual sizes, errors were twice the stated ones.
    """
    worn = partial(gears, waves_rad=3e-4, play_rad=2e-4)
    in_u, stated = [], []
    for seed in range(1, 9):
        moving = simulate(seed, legs=6, duration=120.0, rest=4.0, robot_hz=50.0, gears_of=worn)
        found = aligned_of(moving)
        in_u.append((found.clocks.offset - moving.offset) / found.u_offset)
        stated.append(found.u_offset)
    assert np.sqrt(np.mean(np.square(in_u))) < 1.5
    assert np.median(stated) < 0.3e-3


def test_what_moves_differ_by_is_in_the_uncertainty_of_the_clocks() -> None:
    """The uncertainty of the clocks includes that every move ends a little elsewhere.

    With blocks of time alone, the errors were twice the stated ones.
    """
    in_u = []
    for seed in range(1, 13):
        moving = simulate(seed, legs=10, duration=55.0, rest=1.5, robot_hz=50.0, repeatability_rad=1e-4)
        found = aligned_of(moving)
        clocks = found.clocks
        in_u.append(
            [(clocks.offset - moving.offset) / found.u_offset, (clocks.rate - moving.rate) / found.u_rate]
        )
    assert np.all(np.sqrt(np.mean(np.square(in_u), axis=0)) < 1.5)


def test_windows_that_show_other_moves_give_no_rate() -> None:
    """Windows that look like another move give no rate.

    In a short recording most windows did: the rate began at 10 %, and the fit ended metres away.
    """
    moving = simulate(21, legs=8, duration=120.0)
    found = aligned_of(moving)
    assert found.clocks.offset == pytest.approx(moving.offset, abs=0.5e-3)
    assert found.clocks.rate == pytest.approx(moving.rate, abs=10e-6)


@pytest.mark.parametrize(("who", "ahead"), [("robot", 3.0), ("robot", 3600.0), ("tracker", 3600.0)])
def test_a_clock_that_was_set_forward_is_known_from_lost_samples(who: str, ahead: float) -> None:
    """A clock that was set forward is distinguished from lost samples.

    It leaves a gap in the times as a lost target does; its size may be longer than the recording.
    """
    moving = short(4, rest=1.5)
    if who == "robot":
        moving = replace(moving, robot_time=moving.robot_time + ahead * (moving.robot_time > 80.0))
    else:
        late = np.arange(len(moving.points)) > 700
        moving = replace(moving, tracker_time=moving.tracker_time + ahead * late)
    found = aligned_of(moving)
    sign = 1.0 if who == "robot" else -1.0
    assert found.clocks.step == pytest.approx(sign * ahead, abs=1e-3 if who == "robot" else 0.1)
    assert np.linalg.norm(found.error, axis=1).max() < 0.2
    assert found.warnings == ()


def test_a_second_jump_is_named() -> None:
    moving = simulate(3, jump=(200.0, 0.02))
    later = moving.tracker_time - 0.015 * (np.arange(len(moving.tracker_time)) > 4500)
    found = aligned_of(replace(moving, tracker_time=later))
    assert any("step by another amount" in text for text in found.warnings)


def test_a_lost_target_and_wild_points_change_nothing() -> None:
    moving = short()
    keep = (np.arange(len(moving.points)) < 600) | (np.arange(len(moving.points)) >= 800)
    points = moving.points.copy()
    points[100:130] += 7.0
    spoilt = replace(moving, tracker_time=moving.tracker_time[keep], points=points[keep])
    found = aligned_of(spoilt)
    (gap,) = streams(spoilt)[1].gaps
    assert gap.lost == 200
    assert gap.end - gap.begin == pytest.approx(20.1, abs=0.01)
    assert found.clocks.offset == pytest.approx(moving.offset, abs=1e-3)
    assert set(np.flatnonzero(found.weight == 0.0)) == set(range(100, 130))


def test_nothing_is_interpolated_across_a_gap_of_the_robot() -> None:
    moving = short()
    keep = (moving.robot_time < 60.0) | (moving.robot_time > 63.0)
    cut = replace(moving, robot_time=moving.robot_time[keep], joints=moving.joints[keep])
    found = aligned_of(cut)
    times = found.time
    assert not ((times > 60.01) & (times < 62.99)).any()
    assert found.used.sum() == pytest.approx(len(moving.points) - 30, abs=1)
    assert np.linalg.norm(found.error, axis=1).max() < 0.2


def test_a_lag_is_seen_as_far_as_it_grows_with_speed() -> None:
    bands = by_speed(aligned_of(short(lag_s2_mm=2e-5)), 2.0)
    lags = [band.lag_ms for band in bands]
    assert lags == sorted(lags)
    assert lags[-1] - lags[0] > 1.0  # 2e-5 s per mm/s: some 2 ms from 10 to 120 mm/s
    assert all(band.along_rms > 0.0 and band.across_rms > 0.0 for band in bands)
    still = by_speed(aligned_short(), 2.0)
    assert max(abs(band.lag_ms) for band in still) < 0.6


def test_what_bends_and_errs_with_the_pose_is_said_apart_from_what_moves() -> None:
    """Static errors of a bending arm are separated from a lag.

    All of its nominal error is static, and the noise is left; a lag is not static.
    """
    for lag, left_mm in ((0.0, (0.0, 0.03)), (2e-5, (0.03, 0.1))):
        bands = by_speed(aligned_of(short(2, gears_of=gears, lag_s2_mm=lag)), 2.0)
        for band in bands:
            assert band.static_along_rms == pytest.approx(band.nominal_along_rms, rel=0.1)
            assert band.static_across_rms == pytest.approx(band.nominal_across_rms, rel=0.1)
            assert band.across_rms < 0.05  # 0.02 mm an axis
        assert left_mm[0] < bands[-1].along_rms < left_mm[1]


def test_waypoints_are_counted_and_known_again() -> None:
    moving = short(waypoints=5)
    still = standstills(aligned_of(moving))
    assert still.waypoints == 5
    visited = [int(still.waypoint[still.number == k][0]) for k in range(still.count)]
    # how often it is slow at a waypoint may differ; the order may not
    steps = [k for i, k in enumerate(visited) if i == 0 or k != visited[i - 1]]
    assert steps == [k % 5 for k in range(len(steps))]
    assert len(steps) == 14  # the tracker begins after the first and ends before the last


def test_a_robot_that_creeps_is_cut_into_poses() -> None:
    found = aligned_short()
    all_of_it = standstills(found, 1e6)
    spread = [np.ptp(found.joints[all_of_it.sample[all_of_it.number == k]], axis=0).max() for k in range(50)]
    assert max(spread) <= np.radians(0.4)


class TestDataSet:
    def test_identify_reads_it(self, paper: tuple[Moving, Aligned], tmp_path: Path) -> None:
        _, found = paper
        table = data_set(ROBOT, found, standstills(found), ORIGIN, FINE).hold_out("random", 0.2, 1)
        table.write(tmp_path / "out.csv")
        data = read_dataset(tmp_path / "out.csv")
        held = set(data.waypoint[data.validation_rows])
        assert 6 <= len(held) <= 8
        assert not held & set(data.waypoint[data.fit_rows])
        fit = identify(data)
        assert np.sqrt(np.mean(errors_on(data, data.validation_rows, fit.model, fit.estimate) ** 2)) < 0.1

    def test_every_sample_of_a_waypoint_falls_on_one_side(
        self, paper: tuple[Moving, Aligned], tmp_path: Path
    ) -> None:
        _, found = paper
        still = standstills(found)
        table = data_set(ROBOT, found, still, ORIGIN, FINE, every_sample=True).hold_out("random", 0.3, 2)
        table.write(tmp_path / "out.csv")
        data = read_dataset(tmp_path / "out.csv")
        assert len(data) == len(still.sample)
        assert not set(data.waypoint[data.validation_rows]) & set(data.waypoint[data.fit_rows])
        assert len(np.unique(data.conditions.pose)) == still.waypoints
        # the side of approach is that of the move to the standstill, not of the last digit of its samples
        for k in range(still.count):
            assert len(np.unique(data.conditions.side[still.number == k], axis=0)) == 1

    def test_the_uncertainty_of_a_row_is_what_it_is_wrong_by(self) -> None:
        moving = short(3, rest=2.0)
        found = aligned_of(moving)
        still = standstills(found)
        table = data_set(ROBOT, found, still, ORIGIN, FINE)
        u = np.array([table.columns[f"u_{axis}_mm"] for axis in "xyz"], dtype=float).T
        points = np.array([table.columns[f"{axis}_mm"] for axis in "xyz"], dtype=float).T
        truth = np.array(
            [moving.true_points[still.sample[still.number == k]].mean(axis=0) for k in range(still.count)]
        )
        assert np.sqrt(np.mean(((points - truth) / u) ** 2)) == pytest.approx(1.0, abs=0.35)

    def test_no_row_is_surer_than_the_instrument(self) -> None:
        """An instrument may repeat to a micrometre what it is wrong by."""
        found = aligned_of(short(3, rest=2.0, noise_mm=0.0))
        still = standstills(found)
        for noise, least in (
            (Noise("isotropic", 0.07), 0.07),
            (Noise("tracker", range_mm=0.03, transverse_mm=0.03), 0.03),
        ):
            columns = data_set(ROBOT, found, still, ORIGIN, noise).columns
            u = np.array([columns[f"u_{axis}_mm"] for axis in "xyz"], dtype=float)
            assert u.min() >= least - 1e-6
        assert (
            np.array(data_set(ROBOT, found, still, ORIGIN, FINE).columns["u_x_mm"], dtype=float).min() < 0.01
        )

    def test_samples_that_hang_together_count_less(self) -> None:
        moving = short(3, rest=3.0, noise_mm=0.0)
        slow = np.convolve(
            np.random.default_rng(1).normal(0.0, 0.1, len(moving.points) + 9), np.ones(10) / 10.0, "valid"
        )
        found = aligned_of(replace(moving, points=moving.points + slow[:, None]))
        assert scatter(found, standstills(found))[1] > 0.4
        found = aligned_of(short(3, rest=3.0))
        assert scatter(found, standstills(found))[1] < 0.25

    def test_joints_are_the_controllers(self, paper: tuple[Moving, Aligned]) -> None:
        robot = load_robot("fanuc-lrmate200ic")
        _, found = paper
        still = standstills(found)
        origin = replace(ORIGIN, robot_name="fanuc-lrmate200ic", coupling="fanuc-j23")
        columns = data_set(robot, found, still, origin, FINE).columns
        one = np.radians([float(columns[f"j{k}_deg"][3]) for k in range(1, 7)])
        mean = found.joints[still.sample[still.number == 3]].mean(axis=0)
        np.testing.assert_allclose(robot.model_angles(one[None], "fanuc-j23")[0], mean, atol=1e-7)


def other(moving: Moving) -> Moving:
    """Another recording, with the same rhythm, in place of the robot's."""
    return replace(moving, joints=short(9).joints)


def at_rest(moving: Moving) -> Moving:
    return replace(moving, joints=np.broadcast_to(moving.joints[0], moving.joints.shape))


def never_still(moving: Moving) -> Moving:
    del moving
    swing = np.arange(0.0, 160.0, 0.02)
    circle = np.stack([np.cos(0.3 * swing), np.sin(0.3 * swing)], axis=1)  # of joints 1 and 2: never slow
    joints = short().joints[0] + np.column_stack(
        [0.4 * circle, 0.1 * np.sin(0.11 * swing**1.2), np.zeros((len(swing), 3))]
    )

    points = tool_points(joints, np.zeros((4, 6)))
    return replace(short(), robot_time=swing, joints=joints, tracker_time=swing[::5], points=points[::5])


def apart(moving: Moving) -> Moving:
    """The robot of the first two fifths, the tracker of the last two."""
    first, last = moving.robot_time < 64.0, np.arange(len(moving.points)) > 0.6 * len(moving.points)
    return replace(
        moving,
        robot_time=moving.robot_time[first],
        joints=moving.joints[first],
        tracker_time=moving.tracker_time[last],
        points=moving.points[last],
    )


BAD = {
    "streams that do not overlap": (apart, "do not show one motion|overlap in time"),
    "streams of two motions": (other, "do not show one motion|is not the motion"),
    "a robot that never moves": (at_rest, "robot stream: nothing moves in it"),
    "a tracker that sees a fixed point": (
        lambda m: replace(m, points=m.points[:1] + 0.01 * m.points / 1e3),
        "tracker stream: nothing moves in it",
    ),
    "joints in degrees": (
        lambda m: replace(m, joints=np.degrees(m.joints)),
        "do not show one motion|is not the motion",
    ),
    "a joint with the wrong sign": (
        lambda m: replace(m, joints=m.joints * [1, -1, 1, 1, 1, 1]),
        "do not show one motion|Check robot, tool, order, signs",
    ),
    "a few samples of overlap": (
        lambda m: replace(m, tracker_time=m.tracker_time[:40], points=m.points[:40]),
        "overlaps with the robot stream in 40 samples only",
    ),
    "a time that is given twice": (
        lambda m: replace(m, tracker_time=np.repeat(m.tracker_time, 2)[: len(m.points)]),
        "sample 2: .* is given twice, but times must increase",
    ),
    "a clock that goes back": (
        lambda m: replace(m, robot_time=m.robot_time - 5.0 * (m.robot_time > 80.0)),
        "sample 4002: the time 80 s is followed by 75.02 s, but times must increase",
    ),
    "milliseconds as seconds": (
        lambda m: replace(m, robot_time=m.robot_time * 1e6),
        "lasts .* the stated unit of its times is wrong",
    ),
    "a robot that never stands still": (never_still, "never stands still: .* never slower than 2 mm/s"),
    "too few samples": (
        lambda m: replace(m, robot_time=m.robot_time[:10], joints=m.joints[:10]),
        "robot stream: has 10 samples",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_stream_that_cannot_be_aligned_is_refused_by_name(case: str) -> None:
    spoil, message = BAD[case]
    with pytest.raises(DataError, match=message):
        standstills(aligned_of(spoil(short())))


def test_a_path_that_repeats_itself_is_named() -> None:
    moving = short(waypoints=4, legs=25, duration=250.0)
    found = aligned_of(moving)
    assert any("The path repeats itself: an offset of" in text for text in found.warnings)
