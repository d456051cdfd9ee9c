"""What a calibration left open: as a fit of everything at once has it, kept in the file, and no news to a watch.

These would catch: small play of every joint, which no diagnosis claims, that the first watch takes for worn gears; a
change that is counted twice, as change and as what was there before; a frame that is surer than the way it is set up.
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
from calib.fit.identification import Identification
from calib.fit.readings import linearised
from calib.saved import SavedModel, as_saved, load_model, save_model
from calib.saved.left_open import LeftOpen
from calib.units import DEG
from calib.watch import Seen, judge, updated
from calib.watch.cause import fitted
from calib.watch.frame import frame_covariance
from calib.watch.judge import odds_of
from calib.watch.lack import scatter_beyond
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
def found(tmp_path_factory: pytest.TempPathFactory) -> Identification:
    return identify(data_of(worn(WORN), tmp_path_factory.mktemp("worn"), 51, 1))


@pytest.fixture(scope="module")
def saved(found: Identification) -> SavedModel:
    return as_saved(found)


def test_it_is_what_a_fit_of_everything_at_once_leaves_open(found: Identification) -> None:
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


def test_play_that_the_calibration_did_not_see_is_no_news(saved: SavedModel, tmp_path: Path) -> None:
    watch = data_of(worn(WORN), tmp_path, 120, 9)
    assert judge(Seen.of(saved, watch)).kind == "unchanged"
    believed = replace(saved, left_open=None, degrees_of_freedom=None, noise_scale=1.0)
    assert judge(Seen.of(believed, watch)).kind != "unchanged"


def test_a_change_is_added_to_what_was_left_open(saved: SavedModel, tmp_path: Path) -> None:
    watch = data_of(worn({**WORN, "j2": 0.06}), tmp_path, 120, 9)
    seen = Seen.of(saved, watch)
    effect = next(e for e in seen.causes if e.label == "backlash:j2")
    cause = fitted(seen, effect, odds_of(seen)[0])
    assert cause.values[0] / DEG == pytest.approx(0.058, abs=0.006)
    model, estimate, covariance = updated(saved, seen, cause)
    after = replace(saved, model=model, estimate=estimate, covariance=covariance)
    assert judge(Seen.of(after, watch)).kind == "unchanged"


def test_the_file_keeps_it_and_refuses_what_it_cannot_be(found: Identification, tmp_path: Path) -> None:
    file = tmp_path / "m.json"
    save_model(file, found)
    read, made = load_model(file), as_saved(found)
    assert read.left_open is not None
    assert made.left_open is not None
    np.testing.assert_allclose(read.left_open.covariance, made.left_open.covariance, rtol=1e-9)
    np.testing.assert_allclose(read.left_open.taken_on, made.left_open.taken_on, rtol=1e-9)
    assert read.degrees_of_freedom == found.degrees_of_freedom
    table = made.left_open.to_json()
    impossible = np.array(table["covariance_internal_units"])
    impossible[0, 1] *= -1e6
    for key, value in (
        ("covariance_internal_units", impossible.tolist()),
        ("covariance_internal_units", [[0.0]]),
        ("estimate_internal_units", [float("nan")]),
        ("taken_on_internal_units", [*table["taken_on_internal_units"], [0.0]]),
    ):
        with pytest.raises(DataError, match="left_open"):
            LeftOpen.from_json({**table, key: value}, found.model, file)


def test_a_lack_is_shown_by_the_more_readings_the_more(saved: SavedModel, tmp_path: Path) -> None:
    """A fit that leaves what was declared and a held-out error that is too large: between both, by their readings."""
    watch = data_of(worn({}), tmp_path, 30, 3)
    both = replace(saved, noise_scale=1.0, held_out_rms_mm=0.12, covariance=0.0 * saved.covariance)
    held, more, most = (
        scatter_beyond(replace(both, degrees_of_freedom=freedom, held_out=20), watch)
        for freedom in (None, 60, 6000)
    )
    assert held > more > most > 0.0
    # with the variances of mean squares, 2 s^4 / n: of 60 rows each
    known = _known(both, watch)
    assert (more / held) ** 2 == pytest.approx(known**2 / (known**2 + 0.12**4), rel=1e-6)


def _known(saved: SavedModel, watch: Dataset) -> float:
    """The mean square that was declared, mm2: the held-out error at which nothing is lacking."""
    low, high = 0.01, 0.12
    for _ in range(60):
        middle = 0.5 * (low + high)
        lacks = scatter_beyond(replace(saved, degrees_of_freedom=None, held_out_rms_mm=middle), watch) > 0.0
        low, high = (low, middle) if lacks else (middle, high)
    return low**2


def test_readings_without_a_clock_are_judged(saved: SavedModel, tmp_path: Path) -> None:
    """A drift of the calibration's instrument may have been left open; a watch by touch has no times."""
    watch = data_of(worn(WORN), tmp_path, 30, 9)
    nothing = np.full(len(watch), np.nan)
    watch = replace(watch, conditions=replace(watch.conditions, time=nothing, temperature=nothing))
    assert np.all(np.isfinite(Seen.of(saved, watch).spread()))


def test_nests_in_a_line_span_no_frame() -> None:
    nests = {f"N{k}": (100.0 * k, 0.0, 0.0) for k in range(3)}
    with pytest.raises(DataError, match="in a line"):
        frame_covariance(nests, Noise("isotropic", sigma_mm=0.02), (0.0, 0.0, 0.0))
