"""Test the diagnosis from end to end on simulated campaigns with known hidden effects.

These would catch: an effect that is missed, misnamed or of the wrong size, claims on complete sets, and validation
rows that affect a choice. They would also catch a step dated wrongly, and a missing claim reported as absence.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.data.read import read_dataset
from calib.diagnose.diagnosis import DiagnosisFit, diagnose
from calib.model.effect import Effect
from calib.units import to_display
from mocks.campaign import Campaign, make_campaign
from tests.calib.campaigns import simulate, true_points, write_files


def values_of(diagnosis: DiagnosisFit, label: str) -> dict[str, tuple[float, float]]:
    """Short name -> (value, standard error) in the unit that is shown."""
    found = next(f for f in diagnosis.effects if f.effect.label == label)
    spread = np.sqrt(np.diag(found.covariance))
    return {
        p.short: (to_display(float(v), p.unit), to_display(float(s), p.unit))
        for p, v, s in zip(found.effect.parameters, found.values, spread, strict=True)
    }


def hidden(campaign: Campaign, label: str) -> dict[str, float]:
    effect = next(e for e in campaign.truth["effects"] if e["label"] == label)
    return {name: entry["value"] for name, entry in effect["parameters"].items()}


def labels(diagnosis: DiagnosisFit) -> list[str]:
    return sorted(f.effect.label for f in diagnosis.effects)


SINGLE = [
    ("abb-irb120", 11, "backlash:j4"),
    ("abb-irb120", 12, "periodic:j2:n3"),
    ("abb-irb120", 13, "periodic:j6:n101"),
    ("abb-irb120", 14, "drift_translation"),
    ("abb-irb120", 15, "drift_rotation"),
    ("abb-irb120", 16, "base_shift"),
    ("abb-irb120", 17, "tool_shift"),
    ("abb-irb120", 18, "thermal_growth"),
    ("fanuc-lrmate200ic", 19, "backlash:j2"),
    ("ur10", 20, "encoder_scale:j1"),
    ("ur10", 21, "periodic:j3:n50"),
]


# Laws that another one of the list has, on another robot or of another order, are left to `make long`
TWICE = {12, 15, 19, 21}
SETS = [pytest.param(*each, marks=pytest.mark.whole if each[1] in TWICE else ()) for each in SINGLE]


@pytest.mark.parametrize(("robot", "seed", "label"), SETS, ids=lambda v: str(v))
def test_the_hidden_effect_is_named_and_measured(robot: str, seed: int, label: str, tmp_path: Path) -> None:
    campaign, data = simulate(tmp_path, robot, seed=seed, n=200, n_validation=60, effects=[label])
    result = diagnose(data)
    assert labels(result) == [label]
    assert result.verdict == "attributed"
    found = result.effects[0]
    assert next(iter(found.evidence.candidates)) == label
    assert found.evidence.certain
    assert found.evidence.p_value < 1e-6
    assert found.evidence.delta_bic > 20.0
    rank = "at_reading" in hidden(campaign, label)
    assert (found.index is not None) == rank
    if rank:
        assert abs(int(found.index or -9) - hidden(campaign, label)["at_reading"]) <= 1
    assert result.error_before is not None
    assert result.error_after is not None
    assert result.error_nominal is not None
    assert result.error_after.rms < 0.7 * result.error_before.rms < result.error_nominal.rms
    rows = data.validation_rows
    after = result.final.predict(data.conditions.take(rows)) - true_points(campaign)[rows]
    noise = campaign.truth["noise_rms_mm"]
    assert np.sqrt(np.mean(after**2)) < 0.75 * noise, "the truth itself, closer than one reading"
    truth, told = hidden(campaign, label), values_of(result, label)
    pairs: dict[str, tuple[str, float]] = {
        "backlash": ("gap", 1.0),
        "encoder_scale": ("k", 1e6),
        "thermal_growth": ("alpha", 1e6),
    }
    name = label.partition(":")[0]
    if name in pairs:
        key, factor = pairs[name]
        value, spread = next(iter(told.values()))
        assert abs(value - factor * truth[key]) < 4.5 * spread
        assert spread < 0.3 * abs(value)
    if name == "periodic":
        assert found.effect.shape["order"] == truth["order"]
        for ours, theirs in (("cos", "A"), ("sin", "B")):
            assert abs(told[ours][0] - truth[theirs]) < 4.5 * told[ours][1]
    if name.startswith("drift"):
        prefix = "v" if name == "drift_translation" else "w"
        for axis in "xyz":
            value, spread = told[axis if prefix == "v" else f"r{axis}"]
            assert abs(value - truth[prefix + axis]) < 4.5 * spread


@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=() if seed < 34 else pytest.mark.whole) for seed in range(30, 38)]
)
def test_nothing_is_claimed_where_nothing_is_hidden(seed: int, tmp_path: Path) -> None:
    robot = ("abb-irb120", "ur10", "fanuc-lrmate200ic", "abb-irb120")[seed % 4]
    _, data = simulate(tmp_path, robot, seed=seed, n=120, n_validation=40, effects=[])
    result = diagnose(data)
    assert result.effects == ()
    assert result.verdict == "complete"
    assert result.p_lack_of_fit > 1e-3
    assert result.error_after == result.error_before
    np.testing.assert_array_equal(result.base.estimate, result.final.estimate)


def test_several_effects_at_once(tmp_path: Path) -> None:
    wanted = ["backlash:j4", "drift_translation", "periodic:j3:n5", "thermal_growth", "tool_shift"]
    campaign, data = simulate(
        tmp_path, seed=41, n=300, n_validation=60, effects=wanted, gross_rows=6, swapped_rows=6
    )
    result = diagnose(data)
    assert labels(result) == wanted
    assert sum(f.evidence.explained_variance for f in result.effects) > 0.5
    assert all(0.0 < f.evidence.explained_variance < 1.0 for f in result.effects)
    # the effects in the model, every spoilt row is seen for what it is
    assert {str(i) for i in campaign.truth["faulty_rows"]} <= set(result.final.faulty_rows)
    assert len(result.final.faulty_rows) <= 8
    assert {tuple(map(str, r)) for r in result.final.relabelled_rows} == {
        tuple(map(str, r)) for r in campaign.truth["relabelled_rows"]
    }


@pytest.mark.parametrize(("label", "order"), [("periodic:j1:n4.5", 4.5), ("periodic:j6:n100.25", 100.25)])
def test_orders_off_the_whole_numbers(label: str, order: float, tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=42, n=200, n_validation=40, effects=[label], size=4.0)
    result = diagnose(data)
    assert len(result.effects) == 1
    effect = result.effects[0].effect
    assert effect.label.startswith(label.rpartition(":")[0])
    assert effect.shape["order"] == pytest.approx(order, abs=0.08)
    assert not effect.shape["order"].is_integer()


def test_backlash_is_invisible_from_one_side_and_the_result_says_so(tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=43, n=120, n_validation=0, effects=["backlash:j4"], both_sides=False)
    result = diagnose(data)
    assert result.effects == ()
    notes = [note for note in result.notes if "Backlash" in note]
    assert len(notes) == 1
    assert all(f"J{k}" in notes[0] for k in range(1, 7))
    assert "not absent" in notes[0]
    assert result.error_after is None
    assert result.error_nominal is None


def test_what_was_not_recorded_is_noted(tmp_path: Path) -> None:
    campaign = make_campaign(seed=44, n=240, n_validation=0, effects=[])
    rows = [{k: v for k, v in row.items() if k not in ("t_s", "t_air_c")} for row in campaign.rows]
    rows = [row for row in rows if row["tool_target"] == "T2"]
    result = diagnose(read_dataset(write_files(tmp_path / "a", rows, campaign.header)))
    text = " ".join(result.notes)
    assert "no time" in text
    assert "no temperature" in text
    assert "One tool target" in text
    _, data = simulate(tmp_path / "b", seed=44, n=80, n_validation=0, effects=[])
    assert diagnose(data).notes == ()


@pytest.mark.parametrize(("factor", "verdict", "seed"), [(0.5, "excess_noise", 45), (2.0, "complete", 46)])
def test_noise_declared_wrongly_is_no_effect(factor: float, verdict: str, seed: int, tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=seed, n=150, n_validation=0, effects=[], noise_declared_factor=factor)
    result = diagnose(data)
    assert result.effects == ()
    assert result.verdict == verdict
    assert result.final.noise_scale == pytest.approx(1.0 / factor, rel=0.1)


def test_structure_that_no_effect_explains_is_flagged(tmp_path: Path) -> None:
    _, data = simulate(
        tmp_path, seed=47, n=200, n_validation=0, effects=["outside:workspace_field"], size=5.0
    )
    result = diagnose(data)
    assert result.verdict == "unexplained"
    assert result.structure[0].p_value < 1e-3


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, DiagnosisFit]:
    """A campaign whose rows others spoil or shuffle."""
    folder, wanted = tmp_path_factory.mktemp("plain"), ["periodic:j2:n3", "tool_shift"]
    campaign, data = simulate(folder, seed=49, n=120, n_validation=40, effects=wanted)
    result = diagnose(data)
    assert labels(result) == wanted
    return campaign, result


def test_order_of_rows_does_not_matter(plain: tuple[Campaign, DiagnosisFit], tmp_path: Path) -> None:
    campaign, one = plain
    rows = [campaign.rows[i] for i in np.random.default_rng(2).permutation(len(campaign.rows))]
    other = diagnose(read_dataset(write_files(tmp_path, rows, campaign.header)))
    assert labels(other) == labels(one)
    assert [f.index for f in one.effects] == [f.index for f in other.effects]
    assert one.error_after is not None
    assert other.error_after is not None
    assert other.error_after.rms == pytest.approx(one.error_after.rms, rel=1e-6)


def test_validation_rows_choose_nothing(plain: tuple[Campaign, DiagnosisFit], tmp_path: Path) -> None:
    """Wild validation rows change only the reported errors, and that nothing is attributed."""
    campaign, tame = plain
    rows = [dict(row) for row in campaign.rows]
    rng = np.random.default_rng(0)
    for row in rows:
        if row["set"] == "validation":
            row |= dict(zip(("x_mm", "y_mm", "z_mm"), rng.uniform(-1e6, 1e6, 3).tolist(), strict=True))
    wild = diagnose(read_dataset(write_files(tmp_path, rows, campaign.header)))
    for one, other in ((tame.base, wild.base), (tame.final, wild.final)):
        np.testing.assert_array_equal(one.estimate, other.estimate)
        np.testing.assert_array_equal(one.covariance, other.covariance)
        np.testing.assert_array_equal(one.readings.rows, other.readings.rows)
        assert (one.faulty_rows, one.relabelled_rows) == (other.faulty_rows, other.relabelled_rows)
    np.testing.assert_array_equal(tame.nominal_estimate, wild.nominal_estimate)
    assert [f.effect for f in tame.effects] == [f.effect for f in wild.effects]
    assert [f.evidence for f in tame.effects] == [f.evidence for f in wild.effects]
    assert (tame.structure, tame.p_lack_of_fit, tame.notes) == (
        wild.structure, wild.p_lack_of_fit, wild.notes
    )  # fmt: skip
    assert (tame.verdict, wild.verdict) == ("attributed", "excess_noise")
    assert tame.error_after is not None
    assert wild.error_after is not None
    assert wild.error_after.rms > 1e3 * tame.error_after.rms


def test_a_narrow_range_confuses_once_and_twice_a_turn(tmp_path: Path) -> None:
    """Joints 2 and 3 over 110 and 150 deg: a first harmonic, a second and a slope look alike. Never a wrong name."""
    named = 0
    for seed, label in (
        (50, "periodic:j2:n1"),
        (51, "periodic:j2:n2"),
        (52, "periodic:j3:n1"),
        (54, "periodic:j3:n2"),
    ):
        _, data = simulate(tmp_path / label[-5:], seed=seed, n=150, n_validation=0, effects=[label])
        result = diagnose(data)
        assert len(result.effects) == 1
        candidates = result.effects[0].evidence.candidates
        assert all(name.split(":")[1] == label.split(":")[1] for name in candidates), (
            "the joint is beyond doubt"
        )
        assert label in candidates if len(candidates) == 1 else result.verdict == "ambiguous", (
            label,
            candidates,
        )
        assert sum(candidates.values()) == pytest.approx(1.0)
        assert list(candidates.values()) == sorted(candidates.values(), reverse=True)
        named += label in candidates
    assert named >= 2


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(
            63,
            marks=pytest.mark.xfail(
                strict=True,
                reason="encoder scale explains it better than once a turn does over 0.3 turns, and is named alone",
            ),
        ),
        64,
    ],
)
def test_once_a_turn_of_joint_2_is_never_named_wrongly_as_certain(seed: int, tmp_path: Path) -> None:
    """A once-per-turn error of joint 2 is never named wrongly as certain.

    lambda is 234 and 133 here. The data show the error, but cannot distinguish it from a slope or a second
    harmonic.
    """
    _, data = simulate(tmp_path, seed=seed, n=200, n_validation=50, effects=["periodic:j2:n1"])
    result = diagnose(data)
    candidates = result.effects[0].evidence.candidates
    assert "periodic:j2:n1" in candidates or result.verdict == "ambiguous", candidates


def test_effects_survive_json_and_predict_the_same(tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=53, n=150, n_validation=0, effects=["base_shift", "periodic:j6:n101"])
    result = diagnose(data)
    assert labels(result) == ["base_shift", "periodic:j6:n101"]
    model = result.final.model
    back: list[Effect] = [Effect.from_json(json.loads(json.dumps(e.to_json()))) for e in model.effects]
    assert tuple(back) == model.effects


def test_progress_is_told(tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=11, n=100, n_validation=0, effects=["backlash:j4"])
    lines: list[Any] = []
    limited = diagnose(data, most=1, progress=lines.append)
    assert labels(limited) == ["backlash:j4"]
    assert any("backlash:j4" in line for line in lines)
