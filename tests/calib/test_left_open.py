"""Test the unresolved part of a calibration: fitted jointly, saved, and expected by a watch.

These would catch: small play of every joint, which no diagnosis claims, that the first watch takes for worn gears.
They would also catch a change that is counted twice, as a change and as earlier scatter, and a frame that is more
certain than its set-up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.data import Dataset, Noise, read_dataset
from calib.errors import DataError
from calib.fit import identify
from calib.fit.identification import IdentificationFit
from calib.fit.readings import linearised, readings_of
from calib.saved import CalibratedModel, as_saved, load_model, save_model
from calib.saved.unresolved_effects import LeftOpen
from calib.units import DEG
from calib.watch import WhitenedReadings, judge, updated
from calib.watch.cause import fitted
from calib.watch.judge import odds_of
from calib.watch.whitened_readings import frame_covariance
from mocks.campaign import DEFAULT_FIT, Campaign, write_campaign
from mocks.world import World
from mocks.world.dataset import header_of, row_of
from tests.benchmarks.diagnosis_sets import visits

WORN = {"j1": 0.002, "j2": 0.002, "j3": 0.002, "j4": 0.012, "j5": 0.008, "j6": 0.02}


def worn(gaps: Mapping[str, float]) -> World:
    world = World("abb-irb120", 4, [])
    world.effects = [
        world.draw_effect(f"backlash:{joint}").with_values(gap=gap) for joint, gap in gaps.items()
    ]
    return world


def data_of(world: World, folder: Path, n: int, seed: int) -> Dataset:
    kinds, readings = visits(world, n, 0, 1, 3, "offset", np.random.default_rng(seed))
    rows = [row_of(world, i, *each) for i, each in enumerate(zip(kinds, readings, strict=True))]
    written = write_campaign(Campaign(rows, header_of(world, 1.0, DEFAULT_FIT), {}, world, readings), folder)
    return read_dataset(written["csv"])


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> IdentificationFit:
    return identify(data_of(worn(WORN), tmp_path_factory.mktemp("worn"), 51, 1))


@pytest.fixture(scope="module")
def saved(found: IdentificationFit) -> CalibratedModel:
    return as_saved(found)


def test_it_is_what_a_fit_of_everything_at_once_leaves_open(found: IdentificationFit) -> None:
    left = LeftOpen.of(found)
    model = found.model.append(*(effect.apart("open") for effect in left.effects))
    m, noise = len(found.estimate), max(found.noise_scale, 1.0)
    at = np.concatenate([found.estimate, np.zeros(len(model.parameters) - m)])
    ((_, residual, columns),) = linearised(model, found.readings, at)
    prior = np.concatenate([found.prior, noise / model.prior_std[m:]])
    scale = np.sqrt(np.sum(columns**2, axis=0) + prior**2)
    active = scale > 0.0
    active[:m] &= np.diag(found.covariance) > 0.0
    stacked = np.vstack([columns, np.diag(prior)])[:, active] / scale[active]
    whole = noise**2 * np.linalg.inv(stacked.T @ stacked) / np.outer(scale[active], scale[active])
    held = -prior * (at - model.prior_mean)
    off = np.linalg.lstsq(stacked, np.concatenate([residual.ravel(), held]))[0] / scale[active]
    k = int(active[:m].sum())
    size = np.sqrt(np.diag(left.covariance))
    scaled = whole[k:, k:] / np.outer(size, size)
    np.testing.assert_allclose(left.covariance / np.outer(size, size), scaled, atol=0.02)
    np.testing.assert_allclose(left.estimate / size, off[k:] / size, atol=0.05)
    _, _, together = left.beside(found.model, found.estimate, found.covariance)
    every = np.sqrt(np.diag(whole)[:k])
    np.testing.assert_allclose(
        together[:m, :m][np.ix_(active[:m], active[:m])] / np.outer(every, every),
        whole[:k, :k] / np.outer(every, every),
        rtol=0.02,
        atol=0.02,
    )


def test_play_that_the_calibration_did_not_see_is_no_news(saved: CalibratedModel, tmp_path: Path) -> None:
    watch = data_of(worn(WORN), tmp_path, 120, 9)
    assert judge(WhitenedReadings.of(saved, watch)).kind == "unchanged"
    believed = replace(saved, left_open=None, noise_scale=1.0)
    assert judge(WhitenedReadings.of(believed, watch)).kind != "unchanged"


def test_a_change_is_added_to_what_was_left_open(saved: CalibratedModel, tmp_path: Path) -> None:
    watch = data_of(worn({**WORN, "j2": 0.06}), tmp_path, 120, 9)
    seen = WhitenedReadings.of(saved, watch)
    effect = next(e for e in seen.causes if e.label == "backlash:j2")
    cause = fitted(seen, effect, odds_of(seen)[0])
    assert cause.values[0] / DEG == pytest.approx(0.058, abs=0.006)
    model, estimate, covariance = updated(saved, seen, cause)
    after = replace(saved, model=model, estimate=estimate, covariance=covariance)
    assert judge(WhitenedReadings.of(after, watch)).kind == "unchanged"


def test_the_file_keeps_it_and_refuses_what_it_cannot_be(found: IdentificationFit, tmp_path: Path) -> None:
    file = tmp_path / "m.json"
    save_model(file, found)
    read, made = load_model(file), as_saved(found)
    assert read.left_open is not None
    assert made.left_open is not None
    np.testing.assert_allclose(read.left_open.covariance, made.left_open.covariance, rtol=1e-9)
    np.testing.assert_allclose(read.left_open.taken_on, made.left_open.taken_on, rtol=1e-9)
    assert read.left_open.scatter is not None
    assert made.left_open.scatter is not None
    np.testing.assert_allclose(read.left_open.scatter, made.left_open.scatter, rtol=1e-9)
    assert read.left_open.poses == made.left_open.poses == 17
    table = made.left_open.to_json()
    impossible = np.array(table["covariance_internal_units"])
    impossible[0, 1] *= -1e6
    for key, value in (
        ("covariance_internal_units", impossible.tolist()),
        ("covariance_internal_units", [[0.0]]),
        ("estimate_internal_units", [float("nan")]),
        ("scatter_rad", "much"),
        ("scatter_rad", [0.0]),
        ("poses", [10]),
        ("taken_on_internal_units", [*table["taken_on_internal_units"], [0.0]]),
    ):
        with pytest.raises(DataError, match="left_open"):
            LeftOpen.from_json({**table, key: value}, found.model, file)


def wavy(*sizes_deg: float) -> World:
    """An arm with a wave of such a size, RMS, in every gear."""
    world = worn({})
    world.effects = [
        world.draw_effect(f"periodic:j{k}:n100").with_values(A=size * np.sqrt(2.0), B=0.0)
        for k, size in enumerate(sizes_deg, start=1)
    ]
    return world


def test_what_moves_a_pose_as_a_whole_is_found_as_scatter(tmp_path: Path) -> None:
    """Waves of every gear, 0.005 deg, are found as scatter by 17 and by 40 poses.

    With 17 poses the parameters absorb most of them, with 40 much.
    """
    for n, least, most in ((51, 0.7, 1.4), (120, 0.8, 1.25)):
        left = as_saved(identify(data_of(wavy(*[0.005] * 6), tmp_path, n, 1))).left_open
        assert left is not None
        assert left.scatter is not None
        assert least < np.sqrt(np.mean(left.scatter**2)) / (0.005 * DEG) < most
        assert left.poses == n // 3


def test_every_joint_has_a_scatter_of_its_own(tmp_path: Path) -> None:
    """A small gear of the wrist that is off by six times as much as the others."""
    left = as_saved(
        identify(data_of(wavy(0.003, 0.003, 0.003, 0.003, 0.003, 0.02), tmp_path, 120, 1))
    ).left_open
    assert left is not None
    assert left.scatter is not None
    assert 0.6 < left.scatter[5] / (0.02 * DEG) < 1.7
    assert np.all(left.scatter[:5] < 0.008 * DEG)


def test_a_wave_of_one_cycle_is_known_and_no_scatter(tmp_path: Path) -> None:
    """An eccentric wheel in joint 6 is identified and no scatter.

    One target of a watch shows it as a lost zero of joint 5.
    """
    world = worn({})
    world.effects = [world.draw_effect("periodic:j6:n1").with_values(A=0.012, B=0.009)]
    left = as_saved(identify(data_of(world, tmp_path, 102, 1))).left_open
    assert left is not None
    assert left.scatter is not None
    names = [p.name for effect in left.effects for p in effect.parameters]
    at = [names.index(f"periodic:j6:n1.{part}") for part in ("cos", "sin")]
    np.testing.assert_allclose(left.estimate[at] / DEG, (0.012, 0.009), atol=0.005)
    assert np.all(np.sqrt(np.diag(left.covariance)[at]) < 0.004 * DEG)
    assert left.scatter[5] < 0.004 * DEG  # of 0.0106, root mean square


def test_readings_that_the_fit_has_not_seen_show_what_it_took_on(tmp_path: Path) -> None:
    data = data_of(wavy(*[0.005] * 6), tmp_path, 120, 1)
    few, rest = np.isin(np.arange(120), range(30)), np.isin(np.arange(120), range(30, 120))
    found = identify(replace(data, sets=np.where(few, "calibration", "validation")))
    alone = LeftOpen.of(found).scatter
    both = LeftOpen.of(found, readings_of(data, rest, found.model, found.estimate)).scatter
    assert alone is not None
    assert both is not None
    off = [abs(np.log(np.sqrt(np.mean(s**2)) / (0.005 * DEG))) for s in (alone, both)]
    assert off[1] < 0.15 < off[0]


def test_readings_without_a_clock_are_judged(saved: CalibratedModel, tmp_path: Path) -> None:
    """A watch without times is judged even if a drift of the calibration is unresolved.

    The drift is one of the instrument; a watch by touch has no times.
    """
    watch = data_of(worn(WORN), tmp_path, 30, 9)
    nothing = np.full(len(watch), np.nan)
    watch = replace(watch, conditions=replace(watch.conditions, time=nothing, temperature=nothing))
    assert np.all(np.isfinite(WhitenedReadings.of(saved, watch).spread()))


def test_nests_in_a_line_span_no_frame() -> None:
    nests = {f"N{k}": (100.0 * k, 0.0, 0.0) for k in range(3)}
    with pytest.raises(DataError, match="in a line"):
        frame_covariance(nests, Noise("isotropic", sigma_mm=0.02), (0.0, 0.0, 0.0))
