"""Test the watch: chance, causes and their aliases, updates, means, frames, wrong baselines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acquisition.cell.world_frame import from_nests
from calib import CalibratedModel, DataError, Dataset, identify, read_dataset
from calib.arm import Load
from calib.array import Array
from calib.data import Noise
from calib.model import BoundModel
from calib.model.effect import Effect, Parameter
from calib.saved import as_saved
from calib.units import DEG
from calib.watch import (
    DOUBTFUL,
    PlannedVisits,
    WhitenedReadings,
    append,
    baseline_hash,
    cause_to_update,
    judge,
    plan,
    planned,
    read_history,
    refuse_unlike,
    times_as_uncertain,
)
from calib.watch.cause import _fit, fitted
from calib.watch.cause_evidence import CauseColumns
from calib.watch.judge import WEIGHT, mean_of, odds_of
from calib.watch.whitened_readings import frame_covariance
from mocks.world import ArmState, World
from mocks.world.poses import approach_point, random_pose
from tests.benchmarks.coverage import KINDS, Kind, simulate
from tests.calib.updates import as_updated
from tests.service.campaigns import write_data

SEED, POSES = 4, 10
FILE = Path("model.json")


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return read_dataset(write_data(tmp_path_factory.mktemp("base"), seed=SEED, effects=(), n=150))


@pytest.fixture(scope="module")
def saved(calibration: Dataset) -> CalibratedModel:
    return as_saved(identify(calibration))


@pytest.fixture(scope="module")
def candidates(saved: CalibratedModel) -> tuple[Array, Array, Array]:
    rng, world = np.random.default_rng(1), World(seed=SEED)
    joints = np.radians([random_pose(world.robot, world.targets, rng) for _ in range(60)])
    return joints, rng.choice((-1.0, 1.0), size=joints.shape), np.full(60, 5.0 * DEG)


@pytest.fixture(scope="module")
def measure(
    saved: CalibratedModel, calibration: Dataset, candidates: tuple[Array, Array, Array]
) -> Callable[..., Dataset]:
    """Ten poses of two targets, measured by the independent simulator of the same arm."""
    joints, sides, reach = (each[:POSES] for each in candidates)

    def measured(label: str = "", first: int = 0, **values: float) -> Dataset:
        world = World(seed=SEED)
        world._noise_rng = np.random.default_rng(first)
        if label:
            drawn = world.draw_effect(label)
            values |= dict.fromkeys(drawn.constants, 0.0)
            world.effects = [drawn.with_values(**values)]
        template = planned(
            saved, calibration.header, PlannedVisits.of_points(joints, sides, reach, ("T1", "T2"))
        )
        points = []
        for i, (q, side) in enumerate(zip(np.degrees(joints), sides, strict=True)):
            at, from_side = tuple(q.tolist()), tuple(int(s) for s in side)
            state = ArmState(at, approach_point(at, from_side), from_side, 20.0 * i, 22.0, first + i)
            points += [world.measured_point(state, target) for target in ("T1", "T2")]
        return replace(template, points=np.array(points), sha256=f"{label}{first}{values}")

    return measured


def test_an_unchanged_robot_is_left_alone(saved: CalibratedModel, measure: Callable[..., Dataset]) -> None:
    verdicts = [judge(WhitenedReadings.of(saved, measure(first=100 * i))).kind for i in range(3)]
    assert verdicts == ["unchanged"] * 3


@pytest.mark.parametrize(
    ("label", "values", "cause", "wanted"),
    [
        ("joint_step:j3", {"step": 0.031}, "joint_step:j3", 0.031),
        ("joint_step:j4", {"step": -1.5}, "joint_step:j4", -1.5),  # far beyond where a derivative holds
        ("backlash:j2", {"gap": 0.03}, "backlash:j2", 0.03),
        ("tool_shift", {"dx": 0.2, "dy": 0.0, "dz": 0.0}, "tool_shift", 0.2),
        ("base_shift", {"dx": 0.0, "dy": 0.0, "dz": 0.3}, "base_shift", 0.3),
        ("payload_mass", {"mass": 0.8}, "payload_mass", 0.8),
        ("tracker_scale", {"s": 60.0}, "tracker_scale", 60.0),  # six times what is usual
    ],
)
def test_a_change_is_named_with_its_size(
    saved: CalibratedModel,
    measure: Callable[..., Dataset],
    label: str,
    values: dict[str, float],
    cause: str,
    wanted: float,
) -> None:
    data = measure(label, **values)
    verdict = judge(WhitenedReadings.of(saved, data))
    assert verdict.kind == "changed"
    assert verdict.cause is not None
    assert verdict.cause.label == cause
    size = verdict.cause.size
    assert abs(size.value - wanted) < 1.5 * size.u
    assert size.u < 0.3 * abs(wanted)


def test_what_no_poses_tell_apart_is_never_one_name(
    saved: CalibratedModel, measure: Callable[..., Dataset]
) -> None:
    for label, twin in (("joint_step:j1", "base_shift"), ("joint_step:j6", "tool_shift")):
        verdict = judge(WhitenedReadings.of(saved, measure(label, step=0.06)))
        assert verdict.kind == "ambiguous"
        assert {cause.label for cause, _ in verdict.causes} == {label, twin}
        assert not verdict.apart
        assert "Or: " in verdict.in_words


def test_what_no_cause_explains_is_not_named(saved: CalibratedModel, measure: Callable[..., Dataset]) -> None:
    verdict = judge(WhitenedReadings.of(saved, measure("encoder_scale:j2", k=1e-3)))
    assert verdict.kind == "unexplained"
    with pytest.raises(DataError, match="not known"):
        cause_to_update(verdict)


def test_false_alarms_come_at_the_stated_rate(
    saved: CalibratedModel, measure: Callable[..., Dataset]
) -> None:
    _, odds = odds_of(WhitenedReadings.of(saved, measure()))
    white = np.random.default_rng(99).normal(size=(6000, odds.rows))
    smallest = odds.p_values(white).min(axis=1)
    assert np.mean(smallest < odds.limit(0.05)) == pytest.approx(0.05, abs=0.01)
    assert np.mean(smallest < 0.05) > 0.2  # without the limit of all questions together


def test_the_error_of_the_baseline_is_in_the_spread(
    saved: CalibratedModel, measure: Callable[..., Dataset]
) -> None:
    """Whitened residuals include the error of the baseline.

    Residuals of models drawn from the covariance, through the chain, are white together with the noise.
    """
    data = measure()
    seen = WhitenedReadings.of(saved, data, lack=np.zeros(6))
    noise = np.random.default_rng(5)
    size = np.sqrt(np.diag(seen.covariance))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(seen.covariance / np.outer(scale, scale))
    root = size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    design = BoundModel(seen.model, seen.readings.conditions)
    whiten = np.linalg.inv(np.linalg.cholesky(seen.spread()))
    sums = []
    for _ in range(200):
        other = design.predict(seen.estimate + root @ noise.normal(size=len(root)))
        residual = WhitenedReadings.of(replace(saved), replace(data, points=other)).residual
        sums.append(np.sum((whiten @ (residual + noise.normal(size=len(residual)))) ** 2))
    assert np.mean(sums) == pytest.approx(len(seen.residual), rel=0.05)


def test_an_updated_model_sees_no_change(saved: CalibratedModel, measure: Callable[..., Dataset]) -> None:
    seen = WhitenedReadings.of(saved, measure("joint_step:j3", step=0.05))
    updated = as_updated(saved, seen, cause_to_update(judge(seen)))
    assert updated.model.index["joint_step:j3.step"] == len(saved.estimate)
    again = measure("joint_step:j3", first=700, step=0.05)
    assert judge(WhitenedReadings.of(updated, again)).kind == "unchanged"
    assert np.linalg.eigvalsh(updated.covariance).min() > -1e-15
    # a second change of the same joint goes into the same parameter
    further = WhitenedReadings.of(updated, measure("joint_step:j3", first=800, step=0.12))
    twice = as_updated(updated, further, cause_to_update(judge(further)))
    assert len(twice.estimate) == len(updated.estimate)
    assert twice.estimate[-1] / DEG == pytest.approx(0.12, abs=0.01)


def test_a_base_that_only_shifted_is_not_turned(
    saved: CalibratedModel, measure: Callable[..., Dataset]
) -> None:
    """A base that only shifted is not turned.

    Otherwise a turn from noise would move a distant robot by more than the uncertainty of the shift.
    """
    data = measure("base_shift", dx=0.1, dy=-0.05, dz=0.1)
    seen = WhitenedReadings.of(saved, data)
    cause = next(c for c, _ in judge(seen).causes if c.label == "base_shift")
    turned = _fit(seen, cause.effect, odds_of(seen)[0], None, np.ones(6, dtype=np.bool_))
    assert np.linalg.norm(cause.values[3:]) < 0.3 * np.linalg.norm(turned.values[3:])
    shifted, both = (
        times_as_uncertain(saved, as_updated(saved, seen, each), data.header, ("T2",))
        for each in (cause, turned)
    )
    assert shifted < 0.8 * both
    # one that did turn is turned
    lost = WhitenedReadings.of(saved, measure("joint_offset:j1", offset=0.1))
    found = _fit(lost, cause.effect, odds_of(lost)[0], None, np.ones(6, dtype=np.bool_))
    mean = fitted(lost, cause.effect, odds_of(lost)[0])
    assert mean.values[5] / DEG == pytest.approx(0.1, abs=0.02)
    np.testing.assert_allclose(mean.values, found.values, rtol=0.05, atol=1e-4)


def test_few_readings_make_an_update_worth_less(
    saved: CalibratedModel, measure: Callable[..., Dataset]
) -> None:
    data = measure("tool_shift", dx=0.2, dy=0.0, dz=0.0)
    worth = []
    for count in (4, 20):
        status = np.array(["ok" if k < count else "rejected:not taken" for k in range(len(data))])
        seen = WhitenedReadings.of(saved, replace(data, status=status))
        cause = fitted(seen, next(e for e in seen.causes if e.label == "tool_shift"), odds_of(seen)[0])
        worth.append(times_as_uncertain(saved, as_updated(saved, seen, cause), data.header, ("T2",)))
    assert worth[0] > DOUBTFUL
    assert 1.0 < worth[1] < 0.8 * worth[0]


def test_the_mean_is_the_recursion_over_its_weight() -> None:
    residuals = np.random.default_rng(2).normal(size=(6, 4))
    z, variance = np.zeros(4), 0.0
    for r in residuals:
        z, variance = WEIGHT * r + (1 - WEIGHT) * z, WEIGHT**2 + (1 - WEIGHT) ** 2 * variance
    grown = 1 - (1 - WEIGHT) ** 6
    mean = mean_of(residuals)
    np.testing.assert_allclose(mean.residual, z / grown)
    assert mean.share == pytest.approx(variance / grown**2)


def test_a_small_change_shows_in_the_mean(saved: CalibratedModel, measure: Callable[..., Dataset]) -> None:
    small = [
        WhitenedReadings.of(saved, measure("joint_step:j3", first=100 * i, step=0.006)) for i in range(1, 9)
    ]
    verdict = judge(small[-1], [seen.residual for seen in small[:-1]])
    alone, together = verdict.questions
    assert together.watches == 8
    assert together.p_value < 1e-3 * alone.p_value
    assert verdict.kind in ("changed", "ambiguous")
    assert "joint_step:j3" in [cause.label for cause, _ in verdict.causes]


def test_a_history_is_appended_once_and_keeps_baselines_apart(
    saved: CalibratedModel, measure: Callable[..., Dataset], tmp_path: Path
) -> None:
    file, baseline = tmp_path / "h.jsonl", baseline_hash(saved)
    assert read_history(file).lines == ()
    for first in (0, 100):
        data = measure(first=first)
        seen = WhitenedReadings.of(saved, data)
        before, _ = read_history(file).before(seen, data, baseline)
        append(file, seen, data, baseline, judge(seen, before))
        if first == 0:
            file.write_text(file.read_text("utf-8").rstrip("\n"), "utf-8")  # as a cut or an editor leaves it
    history = read_history(file)
    data = measure(first=100)
    assert history.holds(data)
    before, left_out = history.before(WhitenedReadings.of(saved, data), data, baseline)
    assert (len(before), left_out) == (1, 0)  # itself is not among those before it
    oldest = measure(first=0)
    assert history.before(WhitenedReadings.of(saved, oldest), oldest, baseline) == (
        [],
        0,
    )  # nor those behind it
    new = measure(first=300)
    assert history.before(WhitenedReadings.of(saved, new), new, "another model") == ([], 2)
    file.write_text(file.read_text("utf-8") + "{}\n", "utf-8")
    with pytest.raises(DataError, match="line 3"):
        read_history(file)


def test_the_frame_on_nests_is_as_uncertain_as_it_is_set_up() -> None:
    nests = {"N1": (0.0, 0.0, 0.0), "N2": (600.0, 0.0, 0.0), "N3": (0.0, 600.0, 250.0)}
    places, rng, off = np.array(list(nests.values())), np.random.default_rng(3), []
    point = np.array([400.0, 300.0, 500.0])
    for _ in range(4000):
        read = places + 0.02 * rng.normal(size=places.shape)
        frame = from_nests(dict(zip(nests, read, strict=True)), nests)  # as a record sets it up
        off.append(frame.to_world(point) - point)
    covariance = frame_covariance(nests, Noise("isotropic", sigma_mm=0.02), (0.0, 0.0, 0.0))
    x, y, z = point
    moves = np.hstack([np.eye(3), np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])])
    np.testing.assert_allclose(np.cov(np.array(off).T), moves @ covariance @ moves.T, atol=2e-5, rtol=0.1)
    assert not frame_covariance({}, Noise("isotropic", sigma_mm=0.02), (0.0, 0.0, 0.0)).any()


def test_a_plan_says_what_is_seen_and_what_never_alone(
    saved: CalibratedModel, calibration: Dataset, candidates: tuple[Array, Array, Array]
) -> None:
    found = plan(saved, calibration.header, PlannedVisits.of_points(*candidates, ("T2",)), 8)
    assert len(set(found.chosen)) == 8
    by_label = {each.label: each for each in found.shown.causes}
    assert by_label["joint_step:j1"].always == ("base_shift",)
    assert by_label["joint_step:j6"].always == ("tool_shift",)
    assert by_label["joint_step:j3"].always == ()
    assert 0.001 < by_label["joint_step:j3"].size < 0.05
    # a bad instrument sees less
    noisy = replace(
        calibration.header, noise=replace(calibration.header.noise, transverse_mm=0.1, range_mm=0.1)
    )
    worse = {
        each.label: each
        for each in plan(saved, noisy, PlannedVisits.of_points(*candidates, ("T2",)), 8).shown.causes
    }
    assert worse["joint_step:j3"].size > 2.0 * by_label["joint_step:j3"].size
    with pytest.raises(DataError, match="poses"):
        plan(saved, calibration.header, PlannedVisits.of_points(*candidates, ("T2",)), 3)


def test_from_one_side_no_play_is_seen(
    saved: CalibratedModel, calibration: Dataset, candidates: tuple[Array, Array, Array]
) -> None:
    joints, sides, reach = candidates
    found = plan(
        saved, calibration.header, PlannedVisits.of_points(joints, np.ones_like(sides), reach, ("T2",)), 6
    )
    assert not any(each.label.startswith("backlash") for each in found.shown.causes)


def _warm(data: Dataset) -> Dataset:
    return replace(data, conditions=replace(data.conditions, temperature=data.conditions.temperature + 8.0))


def _elsewhere(data: Dataset) -> Dataset:
    noise = replace(data.header.noise, station_mm=(2000.0, 0.0, 300.0))
    return replace(data, header=replace(data.header, noise=noise))


def _heavy(data: Dataset) -> Dataset:
    loads = (*data.header.loads, Load(data.header.robot.joints, 0.5, (0.0, 0.0, 30.0)))
    return replace(data, header=replace(data.header, loads=loads))


def _other_arm(data: Dataset) -> Dataset:
    loads = tuple(replace(load, mass_kg=load.mass_kg + 0.5) for load in data.header.loads)
    return replace(data, header=replace(data.header, loads=loads))


def _other_tool(data: Dataset) -> Dataset:
    targets = {**data.header.targets, "T2": (75.0, 93.675, 216.0)}
    return replace(data, header=replace(data.header, targets=targets))


def _given_up(data: Dataset) -> Dataset:
    status = data.status.astype("U30")
    status[4:6] = "rejected:beam broken"
    return replace(data, status=status)


def _other_serial(data: Dataset) -> Dataset:
    return replace(data, header=replace(data.header, devices=({"role": "robot", "serial": "77"},)))


@pytest.mark.parametrize(
    ("spoil", "key", "says"),
    [
        (_warm, "t_air_c", "no law of temperature"),
        (_elsewhere, "nests", "--new-frame"),
        (_heavy, "loads", "kg on the last link"),
        (_other_arm, "loads", "other masses of link"),
        (_other_tool, "tool_targets", "'T2'"),
        (_given_up, "status", "beam broken"),
        (_other_serial, "device.serial", "robot 12"),
    ],
)
def test_what_is_no_watch_of_the_baseline_is_refused_by_name(
    saved: CalibratedModel,
    measure: Callable[..., Dataset],
    spoil: Callable[[Dataset], Dataset],
    key: str,
    says: str,
) -> None:
    known = replace(saved, devices=({"role": "robot", "serial": "12"},))
    data = replace(measure(), path=Path("watch.csv"))
    refuse_unlike(known, data, FILE, frame_known=True, missing_allowed=False)
    with pytest.raises(DataError, match=says) as refused:
        refuse_unlike(known, spoil(data), FILE, frame_known=True, missing_allowed=False)
    assert refused.value.key == key


def test_a_new_frame_hides_a_moved_base_and_nothing_else(
    saved: CalibratedModel, measure: Callable[..., Dataset]
) -> None:
    moved = measure("base_shift", dx=1.0, dy=2.0, dz=0.5)
    assert judge(WhitenedReadings.of(saved, moved)).kind == "changed"
    assert judge(WhitenedReadings.of(saved, moved, frame_known=False)).kind == "unchanged"
    lost = judge(WhitenedReadings.of(saved, measure("joint_step:j3", step=0.05), frame_known=False))
    assert "joint_step:j3" in [cause.label for cause, _ in lost.causes]


@pytest.mark.parametrize(
    "kind", [k for k in KINDS if k.name in ("poses, tool unknown", "distances")], ids=lambda kind: kind.name
)
def test_poses_and_distances_are_judged_as_points_are(kind: Kind) -> None:
    """Poses and distances are judged like points; joint 3 is 0.08 deg off.

    The second arm of the benchmarks measures them.
    """
    data = simulate(kind, 3).data
    baseline = as_saved(identify(data))
    status = np.full(len(data), "rejected:not visited")
    status[np.flatnonzero(data.fit_rows)[:40]] = "ok"
    data = replace(data, status=status)
    assert judge(WhitenedReadings.of(baseline, data)).kind == "unchanged"
    joints = data.conditions.joints - np.array([0.0, 0.0, 0.08 * DEG, 0.0, 0.0, 0.0])
    verdict = judge(
        WhitenedReadings.of(baseline, replace(data, conditions=replace(data.conditions, joints=joints)))
    )
    assert verdict.cause is not None
    assert verdict.cause.label == "joint_step:j3"
    assert verdict.cause.size.value == pytest.approx(0.08, abs=1.5 * verdict.cause.size.u)


def test_the_evidence_is_the_bayes_factor_of_a_gaussian() -> None:
    """The evidence is log N(r; 0, 1 + A S^2 A') - log N(r; 0, 1), with its determinant."""
    rng = np.random.default_rng(7)
    columns = rng.normal(size=(9, 3)) * [0.3, 1.0, 5.0]
    parameters = tuple(Parameter(f"made_up.p{k}", "mm", 1.0) for k in range(3))
    effect = Effect("made_up", "transmission", "robot", "", parameters, ())
    cause = CauseColumns.of(effect, columns)
    residual = rng.normal(size=(4, 9))
    spread = np.eye(9) + columns @ columns.T
    explained = np.einsum("ij,ij->i", residual, residual - np.linalg.solve(spread, residual.T).T)
    want = 0.5 * explained - 0.5 * np.linalg.slogdet(spread).logabsdet
    np.testing.assert_allclose(cause.whole(residual), want, rtol=1e-9)
