"""Test physical limits, and effects that no reading can distinguish.

These would catch: a negative gap that is named, and a candidate that is ruled out although noise explains its sign.
They would also catch an equal column that is left out of the class for its label or its number of columns, and a
certainty without grounds.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import DiagnosisFit, identify, load_robot
from calib.diagnose import diagnose
from calib.diagnose.select import judge, refit
from calib.effects import Survey, offers
from calib.effects.elasticity import pedestal
from calib.effects.geometry import base_shift, parallel_twist
from calib.effects.transmission import backlash, lost_motion, periodic, settling
from calib.scan import Candidate, Scores, Space
from calib.scan.scores import bounds_of, impossible
from mocks.world import ArmState, Session, World
from mocks.world.poses import approach_point
from tests.benchmarks.diagnosis_sets import load, measured
from tests.calib.campaigns import simulate

LAG = {"settling:j4", "lost_motion:j4"}


def classes(result: DiagnosisFit) -> list[dict[str, float]]:
    return [f.evidence.candidates for f in result.effects]


@pytest.mark.parametrize("label", sorted(LAG))
def test_after_moves_of_one_length_a_lag_is_one_class_and_no_backlash(label: str, tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=2, n=120, n_validation=0, effects=[label])
    result = diagnose(data)
    ((found),) = classes(result)
    assert set(found) == LAG
    assert max(found.values()) == pytest.approx(0.5, abs=0.01)
    assert result.verdict == "ambiguous"
    assert result.follow_up is not None
    assert result.follow_up.helps


@pytest.mark.parametrize(
    ("label", "approach"),
    [
        ("backlash:j4", "offset"),
        ("backlash:j4", "varied"),
        ("settling:j4", "varied"),
        ("lost_motion:j4", "varied"),
    ],
)
def test_signs_and_lengths_tell_them_apart(label: str, approach: str, tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=3, n=120, n_validation=0, effects=[label], approach=approach)
    result = diagnose(data)
    assert classes(result) == [{label: 1.0}]
    assert result.verdict == "attributed"


def test_a_twin_with_another_number_of_columns_is_of_the_class() -> None:
    """A tool shift and a base shift are of one class although the base has more columns.

    The tool never turns and has one target.
    """
    world = World(seed=5, targets={"T1": (80.0, 60.0, 120.0)}, session=Session(160))
    shift = world.draw_effect("tool_shift")
    still = {name: 0.0 for name in shift.amplitudes if name.startswith("r")}
    world.effects = [shift.with_values(**still).times(4.0)]
    rng = np.random.default_rng(5)
    readings = []
    for i in range(160):
        q2, q3 = rng.uniform(10.0, 80.0), rng.uniform(-60.0, 30.0)
        joints = (0.0, q2, q3, 0.0, -q2 - q3, 0.0)
        sides = tuple(int(s) for s in rng.choice((-1, 1), 6))
        state = ArmState(joints, approach_point(joints, sides), sides, 20.0 * (i + 1), 20.0, i)
        readings.append((state, "T1"))
    (found,) = classes(diagnose(load(measured(world, readings))))
    assert {"tool_shift", "base_shift"} <= set(found)
    assert max(found.values()) < 0.6


def test_a_change_is_a_jump_only_where_the_readings_show_its_moment(tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=11, n=80, n_validation=0, effects=[])
    late = data.conditions.order / 79.0 - 0.5
    creeping = {"base_shift": 0.5, "base_creep": 0.5}
    for done, expected in (
        (late > 0.0, {"base_shift": 1.0}),
        (np.clip(2.0 * late + 0.5, 0.0, 1.0), creeping),
    ):
        moved = replace(data, points=data.points + np.outer(done, [0.1, 0.15, -0.05]))
        step = base_shift(40)
        fitted = refit(moved, identify(moved), (step,))
        family = [offer for offer in offers(Survey.of(fitted, moved)) if offer.label == step.label]
        space = Space.of(fitted)
        assert judge(space, Scores(family, space), step, (step,)).candidates == pytest.approx(expected)


def test_the_wrong_sign_scores_nothing_and_noise_rules_nothing_out(tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=7, n=80, n_validation=0, effects=["lost_motion:j4"])
    fitted = identify(data)
    offers = [
        Candidate(backlash(4)),
        Candidate(lost_motion(4)),
        Candidate(settling(4)),
        Candidate(backlash(3)),
    ]
    scores = Scores(offers, Space.of(fitted))
    wrong, right, twin, _ = (scores.gains(i) for i in range(4))
    assert (float(wrong[0][0]), int(wrong[1][0])) == (0.0, 0)
    assert right[0] == pytest.approx(twin[0], rel=1e-6)
    assert int(right[1][0]) == 1
    # Joint 3 has neither: whatever the sign of what noise makes of it, one of the two always stays.
    stays = [
        bool(Scores([Candidate(make(3))], Space.of(fitted)).gains(0)[1][0])
        for make in (backlash, lost_motion)
    ]
    assert stays == [True, True]


def test_a_fit_that_ends_where_physics_forbids_it_is_not_kept(tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=8, n=80, n_validation=0, effects=["lost_motion:j4"])
    space = Space.of(refit(data, identify(data), (backlash(4), periodic(2, 3.0))))
    assert space.forbids(backlash(4))
    assert not space.forbids(periodic(2, 3.0))
    assert not Space.of(refit(data, identify(data), (lost_motion(4),))).forbids(lost_motion(4))


def test_bounds_are_counted_in_the_noise_of_the_estimate() -> None:
    bounds = bounds_of(backlash(4))
    assert bounds is not None
    values = np.array([[-0.01], [-0.01], [0.005], [0.05]])  # rad; a gap is a degree at most
    errors = np.array([[0.001], [0.005], [0.001], [0.001]])
    assert impossible(bounds, values, errors).tolist() == [True, False, False, True]
    assert bounds_of(parallel_twist(3)) is None
    both = bounds_of(pedestal(load_robot("abb-irb120")))
    assert both is not None
    assert impossible(both, np.array([1.0, -1.0]), np.array([0.1, 0.1])), "one of two parameters is enough"
