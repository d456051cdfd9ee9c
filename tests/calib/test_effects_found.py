"""Test effects that a campaign of points from an upright arm never shows.

These would catch: play that grows with the load but is reported as another effect, a leaning base whose first joint
is never loaded, and a displaced base ball that bends the whole model instead of being named.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import identify, read_dataset
from calib.diagnose import diagnose
from calib.effects import Survey, offers
from calib.effects.elasticity import joint_compliance
from calib.effects.instrument import base_target_shift
from calib.model import BoundModel
from tests.calib.campaigns import simulate, write_files
from tests.calib.cells import NOISE, Cell


def test_play_that_grows_with_the_load_is_named(tmp_path: Path) -> None:
    campaign, data = simulate(
        tmp_path, seed=12, n=150, n_validation=20, effects=["backlash_load:j3"], approach="varied"
    )
    result = diagnose(data)
    (found,) = result.effects
    assert found.evidence.candidates == {"backlash_load:j3": 1.0}
    hidden = campaign.world.effects[0].values["c"]
    assert abs(float(found.values[0]) - hidden) < 4.0 * math.sqrt(found.covariance[0, 0])


def test_a_leaning_base_loads_joint_1(tmp_path: Path) -> None:
    """On a base that leans by 30 deg, the gear of joint 1 yields as well.

    Gravity is that of the base as stated in the header.
    """
    campaign, upright = simulate(tmp_path / "upright", seed=13, n=120, n_validation=0, effects=[])
    lean = math.radians(30.0)
    gravity = [9.81 * math.sin(lean), 0.0, -9.81 * math.cos(lean)]
    header = {**campaign.header, "gravity_base": gravity}
    data = read_dataset(write_files(tmp_path / "leaning", campaign.rows, header))
    assert np.abs(upright.conditions.torque[:, 0]).max() < 1e-6
    assert np.abs(data.conditions.torque[:, 0]).max() > 1e4
    assert "joint_compliance:j1" not in {o.label for o in offers(Survey.of(identify(upright), upright))}
    fitted = identify(data)
    assert "joint_compliance:j1" in {o.label for o in offers(Survey.of(fitted, data))}
    soft = fitted.model.append(joint_compliance(1))
    estimate = np.append(fitted.estimate, 4e-7)
    points = BoundModel(soft, data.conditions).predict(estimate)
    noise = 0.03 * np.random.default_rng(3).normal(size=points.shape)
    result = diagnose(replace(data, points=points + noise))
    (found,) = result.effects
    assert found.effect.label == "joint_compliance:j1"
    assert float(found.values[0]) == pytest.approx(4e-7, rel=0.2)


def test_a_base_ball_out_of_place_is_named(tmp_path: Path) -> None:
    cell = Cell(5)
    declared = {name: place.copy() for name, place in cell.base_targets.items()}
    name = sorted(declared)[1]
    moved = np.array([0.3, -0.2, 0.25])
    cell.base_targets[name] = declared[name] + moved
    cell.measure("l", 220, noise=NOISE)
    places = {ball: place.tolist() for ball, place in declared.items()}
    data = cell.dataset(tmp_path / "declared", base_targets=places)
    result = diagnose(data)
    assert [f.effect.label for f in result.effects] == [f"base_target_shift:{name}"]
    assert result.error_after is not None
    assert result.error_before is not None
    assert result.error_after.rms < 0.5 * result.error_before.rms
    free = identify(cell.dataset(tmp_path / "free", base_targets="free"))
    labels = {o.label for o in offers(Survey.of(free, data))}
    assert base_target_shift(name).label not in labels, "the base model finds where the balls are"
