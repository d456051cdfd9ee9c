"""Test curves of gears: two joints err by thirty orders, one with a single strong order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib import Dataset, DiagnosisFit, identify, load_model, save_model
from calib.array import Array
from calib.diagnose import diagnose
from calib.diagnose.curves import BLOCKS, NormalEquations, blocks_of, gears_to_carry
from calib.effects import Survey, offers
from calib.effects.transmission import mostly
from calib.model import BoundModel
from calib.scan import Scores, Space
from calib.units import DEG
from tests.calib.campaigns import simulate

JOINTS, HIGHEST, SIZE = (1, 4), 30, 0.004  # deg: of each amplitude
STRONG, STRONG_SIZE = (4, 70), 0.02


@dataclass(frozen=True)
class Gears:
    """Hidden gear amplitudes, and the diagnosis of their readings."""

    amplitudes: dict[int, Array]  # joint -> (HIGHEST, 2) cos and sin, rad
    dataset: Dataset
    result: DiagnosisFit

    def curve(self, joint: int, angle: Array) -> Array:
        """Return the hidden curve without the strong order, (n,), rad."""
        return curve_of(self.amplitudes[joint], angle)


def curve_of(amplitudes: Array, angle: Array) -> Array:
    """Sum orders 1 to HIGHEST of amplitudes (HIGHEST, 2) over an angle (n,); rad."""
    waves = np.arange(1, HIGHEST + 1) * angle[:, None]
    cosine, sine = amplitudes.T
    return np.cos(waves) @ cosine + np.sin(waves) @ sine


@pytest.fixture(scope="module")
def gears(tmp_path_factory: pytest.TempPathFactory) -> Gears:
    rng = np.random.default_rng(5)
    _, dataset = simulate(tmp_path_factory.mktemp("gears"), seed=71, n=1000, n_validation=200, effects=[])
    amplitudes = {joint: rng.normal(0.0, SIZE * DEG, (HIGHEST, 2)) for joint in JOINTS}
    joints = dataset.conditions.joints.copy()
    for joint in JOINTS:
        joints[:, joint - 1] += curve_of(amplitudes[joint], dataset.conditions.joints[:, joint - 1])
    joint, order = STRONG
    joints[:, joint - 1] += STRONG_SIZE * DEG * np.cos(order * dataset.conditions.joints[:, joint - 1])
    base = identify(dataset)
    moved = base.predict(replace(dataset.conditions, joints=joints)) - base.predict(dataset.conditions)
    dataset = replace(dataset, points=dataset.points + moved)
    return Gears(amplitudes, dataset, diagnose(dataset))


def test_each_gear_is_one_curve(gears: Gears) -> None:
    labels = [f.effect.label for f in gears.result.effects]
    assert {"gear_orders:j1", "gear_orders:j4"} <= set(labels)
    assert not {f"gear_orders:j{k}" for k in (2, 3, 5, 6)} & set(labels), "left-out blocks gain nothing there"
    assert len(labels) <= 4, labels
    before, after = gears.result.error_before, gears.result.error_after
    assert before is not None
    assert after is not None
    assert after.rms < 0.4 * before.rms


def test_the_order_that_is_far_above_its_neighbours_has_a_name(gears: Gears) -> None:
    found = {f.effect.label: f for f in gears.result.effects}
    wave = found["periodic:j4:n70"]
    assert wave.effect.amplitude(wave.values, wave.covariance)[0] == pytest.approx(STRONG_SIZE, rel=0.15)
    assert "cos70" not in {p.short for p in found["gear_orders:j4"].effect.parameters}


@pytest.mark.parametrize("joint", JOINTS)
def test_the_curve_is_that_of_the_gear_within_its_band(gears: Gears, joint: int) -> None:
    """The found curve is that of the gear within its band.

    Its mean and its first two orders per turn are removed, since the geometry of links can absorb these.
    """
    curve = next(f for f in gears.result.effects if f.effect.label == f"gear_orders:j{joint}")
    conditions = gears.dataset.conditions.take(np.arange(300))
    angle = conditions.joints[:, joint - 1]
    waves = np.array([term.regressor.evaluate(conditions) for term in curve.effect.terms])
    few = np.stack(
        [np.ones(len(angle)), angle, *(f(n * angle) for n in (1, 2) for f in (np.cos, np.sin))], axis=1
    )
    apart = gears.curve(joint, angle) - curve.values @ waves
    free = np.eye(len(angle)) - few @ np.linalg.pinv(few)
    spread = free @ (waves.T @ curve.covariance @ waves) @ free
    ratio = np.sqrt(np.sum((free @ apart) ** 2) / np.trace(spread))
    assert 0.6 < ratio < 1.5
    assert np.std(free @ apart) < 0.25 * np.std(free @ gears.curve(joint, angle))


def test_it_is_told_in_one_sentence(gears: Gears) -> None:
    curve = next(f.effect for f in gears.result.effects if f.effect.label == "gear_orders:j1")
    assert curve.meaning.startswith("Joint 1: gear error over a turn, RMS, mostly orders ")
    assert curve.shape["mostly_to"] <= HIGHEST + 3


def test_a_saved_model_predicts_the_same(gears: Gears, tmp_path: Path) -> None:
    final = gears.result.final
    save_model(tmp_path / "model.json", final, gears.result)
    saved = load_model(tmp_path / "model.json")
    conditions = gears.dataset.conditions
    predicted = BoundModel(saved.model, conditions).predict(saved.estimate)
    np.testing.assert_allclose(predicted, final.predict(conditions), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(saved.covariance, final.covariance, rtol=1e-8)
    assert (tmp_path / "model.json").stat().st_size < 8e6


def test_blocks_leave_whole_poses_out(gears: Gears) -> None:
    """Blocks leave whole poses out, so no pose error confirms a curve on its other visits.

    Poses are visited four times each.
    """
    conditions = gears.dataset.conditions
    joints = np.tile(conditions.joints[: len(conditions) // 4], (4, 1))
    visited = replace(conditions.take(np.arange(len(joints))), joints=joints)
    block, pose = blocks_of(visited), visited.pose
    assert all(len(np.unique(block[pose == k])) == 1 for k in range(pose.max() + 1))
    assert np.bincount(block, minlength=BLOCKS).min() > 0.08 * len(block)


def test_few_poses_carry_no_curves_however_often_they_are_visited(gears: Gears) -> None:
    base = gears.result.base
    readings = base.readings
    assert gears_to_carry(base, gears.dataset) != []
    few = replace(readings.conditions, waypoint=np.arange(len(readings.rows)) % 200)
    visited = replace(base, readings=replace(readings, conditions=few))
    assert gears_to_carry(visited, gears.dataset) == []


def test_few_readings_carry_no_curves(tmp_path: Path) -> None:
    _, dataset = simulate(tmp_path, seed=71, n=200, effects=[])
    assert gears_to_carry(identify(dataset), dataset) == []


def test_blocks_are_stretches_of_every_series(gears: Gears) -> None:
    conditions = gears.dataset.conditions.take(np.arange(160))
    conditions = replace(conditions, series=np.repeat([0, 1], 80), series_names=("day", "night"))
    block = blocks_of(conditions)
    for series in (0, 1):
        assert np.bincount(block[conditions.series == series]).tolist() == [10] * BLOCKS


def test_what_a_block_loses_is_what_a_fit_without_it_predicts(gears: Gears) -> None:
    """The gain on left-out blocks from normal equations agrees with fits without each block.

    The fits on the other blocks are plain least squares.
    """
    fitted = gears.result.base
    active = np.diag(fitted.covariance) > 0.0
    normal = NormalEquations.of(fitted.model, fitted.readings, fitted.estimate, active)
    free = np.full(int(active.sum()), 1e6)
    posterior = normal.posterior(free, np.full(len(free), -1), np.zeros(len(free), dtype=bool), 1)
    gone = np.array([len(free) - 1])
    gains = normal.left_out(posterior, [gone])[0]
    design = BoundModel(fitted.model, fitted.readings.conditions)
    frames = design.frames(fitted.estimate)
    columns = design.columns(fitted.readings.observed.columns(frames, design.slots))[:, active]
    y = fitted.readings.observed.residual(frames).ravel() + columns @ fitted.estimate[active]
    inside = np.broadcast_to(blocks_of(fitted.readings.conditions) == 2, fitted.residual.shape).ravel()

    def error(keep: NDArray[np.int64]) -> float:
        x, *_ = np.linalg.lstsq(columns[~inside][:, keep], y[~inside], rcond=1e-12)
        return float(np.sum((y[inside] - columns[inside][:, keep] @ x) ** 2))

    every = np.arange(len(free))
    assert gains[2] == pytest.approx(error(every[:-1]) - error(every), rel=1e-3, abs=1e-3)


def test_most_of_a_curve_lies_between_the_orders_that_are_told() -> None:
    sizes = np.full(14, 1e-9)
    sizes[8] = 1.0  # orders 16 to 22
    assert mostly(sizes) == (16, 22)


def test_what_the_next_step_of_a_fit_takes_is_no_candidates_gain(gears: Gears) -> None:
    """The next step of an unfinished fit is no candidate's gain.

    A fit that stops short leaves errors that its own columns explain. Similar candidates once seemed to explain
    them.
    """
    base = gears.result.base
    errors = 3.0 * base.standard_errors * np.random.default_rng(2).normal(size=len(base.estimate))
    short = replace(base, estimate=base.estimate + errors)
    library = [
        o
        for o in offers(Survey.of(base, gears.dataset))
        if o.label in ("link_torsion:j3", "pedestal", "bearing_tilt:j4")
    ]
    assert len(library) >= 2
    there, here = Scores(library, Space.of(base)), Scores(library, Space.of(short))
    for index in range(len(library)):
        assert here.gains(index)[0] == pytest.approx(there.gains(index)[0], rel=0.1, abs=2.0)
