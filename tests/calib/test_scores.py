"""Test the search against brute force.

These would catch: sums of the Fourier transform that are not the sums, a projection that omits the priors or a part
of the model, and gains that are not the reduction of the residual. They would also catch an update on entering or
leaving that differs from a new fit.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import Dataset, IdentificationFit, identify, load_robot
from calib.array import Array
from calib.diagnose import select
from calib.diagnose.select import leave_one_out, refine, refit
from calib.effects import Survey, offers
from calib.effects.geometry import tool_shift
from calib.effects.instrument import drift_rotation
from calib.effects.thermal import thermal_growth, warm_up
from calib.effects.transmission import backlash, periodic
from calib.fit.least_squares import Linearisation, solve
from calib.model import BoundModel, Effect
from calib.scan import Scores, Space
from calib.scan.families import ColumnScores, HarmonicScores, StepScores, TrigSums
from calib.scan.scores import evidence_of, p_value
from tests.calib.campaigns import simulate


@given(
    seed=st.integers(0, 2**31),
    n=st.integers(1, 60),
    count=st.integers(1, 700),
    first=st.integers(-20, 2000),
    spacing=st.sampled_from([0.25, 0.5, 1.0]),
    width=st.floats(0.01, 40.0),
)
@settings(max_examples=60)
def test_fast_sums_are_the_sums(
    seed: int, n: int, count: int, first: int, spacing: float, width: float
) -> None:
    """Any angles, also beyond a turn and all in one place; any grid of orders."""
    rng = np.random.default_rng(seed)
    theta = rng.uniform(-width, width, n)
    orders = np.array(first * 0.25 + spacing * np.arange(count), dtype=np.float64)
    values = rng.normal(size=(n, 3))
    fast = TrigSums(theta, orders).of(values)
    slow = np.exp(1j * orders[:, None] * theta) @ values
    assert fast.shape == (count, 3)
    np.testing.assert_allclose(fast, slow, rtol=0.0, atol=2e-9 * np.abs(values).sum(axis=0).max())


class Brute:
    """Brute-force scores from the whole stacked matrix: J above its priors, with columns added."""

    def __init__(self, fitted: IdentificationFit, without: Effect | None = None) -> None:
        self.space = Space.of(fitted)
        model = fitted.model
        out = set() if without is None else {p.name for p in without.parameters}
        dropped = {d.name for d in fitted.dropped}
        self.kept = [i for i, p in enumerate(model.parameters) if p.name not in out | dropped]
        prior = fitted.prior[self.kept]
        self.jacobian = np.vstack([self.space.columns[:, self.kept], np.diag(prior)])
        # what the left-out effect explains goes back into the residual
        back = [i for i, p in enumerate(model.parameters) if p.name in out]
        residual = self.space.residual.ravel() + self.space.columns[:, back] @ fitted.estimate[back]
        self.residual = np.concatenate([residual, -prior * fitted.estimate[self.kept]])
        self.beside = np.zeros((len(self.residual), 0))

    def add(self, effect: Effect) -> None:
        self.beside = np.column_stack([self.beside, self.padded(effect)])

    def padded(self, effect: Effect) -> Array:
        columns = self.space.effect_columns(effect)
        return np.vstack([columns, np.zeros((len(self.residual) - len(columns), columns.shape[1]))])

    def rss(self, extra: Array | None = None) -> float:
        matrix = np.column_stack([self.jacobian, self.beside, *([] if extra is None else [extra])])
        matrix = matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        x, *_ = np.linalg.lstsq(matrix, self.residual, rcond=1e-12)
        return float(np.sum((self.residual - matrix @ x) ** 2))

    def projected(self, effect: Effect) -> tuple[Array, Array]:
        """A = X'PX and b = X'P r."""
        model = np.column_stack([self.jacobian, self.beside])
        q, _ = np.linalg.qr(model / np.linalg.norm(model, axis=0))
        x = self.padded(effect)
        left = x - q @ (q.T @ x)
        return left.T @ left, left.T @ self.residual

    def gain(self, effect: Effect) -> float:
        return self.rss() - self.rss(self.padded(effect))


@pytest.fixture(scope="module")
def complete(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, IdentificationFit]:
    """Fit a base model to readings that hide three effects: the residual is far from noise.

    Noise is declared twelve times too large. Every noise scale is therefore below 1, and the priors weigh the same
    in the fit, in the space and in the brute force.
    """
    _, data = simulate(
        tmp_path_factory.mktemp("scores"),
        seed=8,
        n=50,
        n_validation=0,
        effects=["backlash:j3", "periodic:j2:n7", "tool_shift"],
        noise_declared_factor=12.0,
    )
    return data, identify(data)


def some_places(scores: Scores, index: int) -> list[int]:
    places = len(scores.b[index])
    return (
        [0]
        if places == 1
        else [0, places // 7, places // 2, places - 1, int(np.argmax(scores.gains(index)[0]))]
    )


def compare(scores: Scores, brute: Brute, skip: tuple[str, ...] = ()) -> int:
    """Every family of the library at some places: A, b and gain. Returns how many were compared."""
    assert scores.rss == pytest.approx(brute.rss(), rel=1e-6)  # as far as the fit converged
    compared = 0
    for index, family in enumerate(scores.families):
        gains, freedom = scores.gains(index)
        for place in some_places(scores, index):
            effect = family.effect(place)
            if effect.label in skip:
                continue
            a, b = brute.projected(effect)
            size = np.sqrt(np.sum(brute.padded(effect) ** 2, axis=0))
            scale = np.outer(size, size)
            np.testing.assert_allclose(
                scores.a[index][place] / scale, a / scale, atol=1e-8, err_msg=effect.label
            )
            length = np.linalg.norm(brute.residual)
            np.testing.assert_allclose(
                scores.b[index][place] / size / length, b / size / length, atol=1e-7, err_msg=effect.label
            )
            assert 0 <= freedom[place] <= len(effect.parameters)
            well = np.linalg.eigvalsh(a / scale).min() > 1e-4
            if well:  # where little is left of a column, the gain is a ratio of roundings
                assert freedom[place] == len(effect.parameters)
                expected = brute.gain(effect)
                assert gains[place] == pytest.approx(expected, rel=1e-5, abs=1e-6 * scores.rss), effect.label
                compared += 1
    return compared


def library(fitted: IdentificationFit, space: Space) -> Scores:
    return Scores(offers(Survey(fitted.model.robot, fitted.readings.conditions)), space)


def test_gains_are_what_fitting_with_the_candidate_would_save(
    complete: tuple[Dataset, IdentificationFit],
) -> None:
    _, fitted = complete
    brute = Brute(fitted)
    scores = library(fitted, brute.space)
    kinds = {type(family) for family in scores.families}
    assert {HarmonicScores, StepScores, ColumnScores} == kinds
    assert compare(scores, brute) > 90
    assert scores.freedom == 3 * len(fitted.readings.rows) - len(brute.kept)
    best = max((scores.best_of(i) for i in range(len(scores.families))), key=lambda s: s.gain)
    assert best.gain > 0.2 * scores.rss


@pytest.mark.parametrize(
    "enters",
    [
        (periodic(2, 7.0),),
        (backlash(3), tool_shift(20)),
        (drift_rotation(), periodic(6, 101.25)),
        (warm_up(load_robot("abb-irb120"), 300.0), backlash(2)),
    ],
    ids=lambda enters: "+".join(effect.label for effect in enters),
)
def test_scores_follow_what_enters_and_leaves(
    enters: tuple[Effect, ...], complete: tuple[Dataset, IdentificationFit]
) -> None:
    _, fitted = complete
    brute = Brute(fitted)
    scores = library(fitted, brute.space)
    untouched = scores.copy()
    moves = []
    basis = brute.space.basis_of_readings
    for effect in enters:
        a, b = brute.projected(effect)
        lower: Array = np.asarray(np.linalg.cholesky(a), dtype=np.float64)
        columns = brute.space.effect_columns(effect)
        # of unit length with the priors below it: its part over the readings is shorter
        new: Array = np.asarray(
            np.linalg.solve(lower, (columns - basis @ (basis.T @ columns)).T).T, dtype=np.float64
        )
        coefficients: Array = np.asarray(np.linalg.solve(lower, b), dtype=np.float64)
        scores.move(new, coefficients, enters=True)
        moves.append((new, coefficients))
        basis = np.column_stack([basis, new])
        brute.add(effect)
    labels = tuple(effect.label for effect in enters)
    assert compare(scores, brute, skip=labels) > 25
    for index, family in enumerate(scores.families):  # what is in the model has nothing left to give
        for place in some_places(scores, index):
            if family.effect(place) in enters:
                assert scores.gains(index)[1][place] == 0
    for new, coefficients in reversed(moves):
        scores.move(new, coefficients, enters=False)
    assert scores.rss == pytest.approx(untouched.rss, rel=1e-9)
    assert scores.freedom == untouched.freedom
    for ours, theirs in zip((*scores.a, *scores.b), (*untouched.a, *untouched.b), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-8 * np.abs(theirs).max())


def test_time_constants_are_scanned_and_refined(tmp_path: Path) -> None:
    """Off the grid of the scan, to where the readings fit best."""
    campaign, data = simulate(tmp_path, seed=8, n=200, n_validation=0, effects=["warm_up"], size=6.0)
    truth = campaign.truth["effects"][0]["parameters"]["T_c"]["value"]
    fitted = identify(data)
    scores = library(fitted, Space.of(fitted))
    index = next(i for i, family in enumerate(scores.families) if family.label == "warm_up")
    best = scores.best_of(index)
    assert best.freedom == 1
    assert best.gain > 0.5 * scores.rss
    found = best.effect
    spacing = 1.25
    assert 1.0 / spacing < found.shape["time_constant_s"] / truth < spacing
    whole = fitted
    for _ in range(3):
        whole = refit(data, fitted, (found,))
        (found,) = refine(Space.of(whole), (found,))
    time = found.shape["time_constant_s"]
    assert time == pytest.approx(truth, rel=0.1)
    family = scores.families[index]
    assert time != family.effect(family.place_of(found)).shape["time_constant_s"], "off the grid"
    left = {
        factor: Space.of(refit(data, fitted, (warm_up(whole.model.robot, factor * time),))).rss
        for factor in (0.95, 1.0, 1.05)
    }
    assert left[1.0] < min(left[0.95], left[1.05])
    assert refine(Space.of(whole), (backlash(2),)) == (backlash(2),)


def test_the_search_lets_effects_enter_as_a_fit_would(complete: tuple[Dataset, IdentificationFit]) -> None:
    _, fitted = complete
    brute = Brute(fitted)
    scores = library(fitted, brute.space)
    basis = brute.space.basis
    select._enter(scores, basis, select._new_directions(brute.space, basis, periodic(2, 7.0)))
    brute.add(periodic(2, 7.0))
    assert scores.rss == pytest.approx(brute.rss(), rel=1e-6)


CHOSEN = (backlash(3), periodic(2, 7.0), tool_shift(20))


@pytest.mark.parametrize("effect", CHOSEN, ids=lambda e: e.label)
def test_leaving_one_out_is_fitting_without_it(
    effect: Effect, complete: tuple[Dataset, IdentificationFit]
) -> None:
    data, fitted = complete
    robot = fitted.model.robot
    chosen = (*CHOSEN, thermal_growth(robot, 22.0))
    whole = refit(data, fitted, chosen)
    assert whole.converged
    brute = Brute(whole, without=effect)
    scores = library(whole, Space.of(whole))
    without, gain, columns = leave_one_out(Space.of(whole), scores, effect)
    assert columns == len(effect.parameters)
    # the linearised problem, exactly
    assert brute.rss() == pytest.approx(without.rss, rel=1e-6)
    assert gain == pytest.approx(brute.rss() - scores.rss, rel=1e-5)
    others = tuple(e.label for e in chosen if e is not effect)
    assert compare(without, brute, skip=others) > 25
    assert scores.rss == pytest.approx(Space.of(whole).rss), "leaving one out must not change the scores"
    # and the exact chain, fitted anew with the priors weighing as they did in the whole model
    anew = refit(data, whole, tuple(e for e in chosen if e is not effect))
    design = BoundModel(anew.model, anew.readings.conditions)
    held = whole.model.index["a3"]
    scale = whole.prior[held] * whole.model.prior_std[held]
    at = Linearisation(design, anew.readings.observed, anew.estimate)
    again = solve(at, anew.covariance.diagonal() > 0.0, scale=scale)
    rss = np.sum(again.residual**2) + np.sum((again.prior * again.estimate) ** 2)
    assert rss == pytest.approx(without.rss, rel=2e-3)


def test_the_basis_is_orthonormal_with_its_priors(complete: tuple[Dataset, IdentificationFit]) -> None:
    _, fitted = complete
    space = Space.of(fitted)
    eigenvalues = np.linalg.eigvalsh(space.basis.T @ space.basis)
    assert eigenvalues.max() < 1.0 + 1e-12
    assert eigenvalues.min() > 0.5
    np.testing.assert_allclose(
        space.covariance * max(fitted.noise_scale, 1.0) ** 2, fitted.covariance, rtol=1e-4, atol=1e-16
    )


def test_the_residual_is_orthogonal_to_what_the_model_explains(tmp_path: Path) -> None:
    """The scores take b = X'r for X'Pr. That holds only where the priors of the space are those of the fit."""
    _, data = simulate(tmp_path, seed=6, n=50, n_validation=0, effects=["backlash:j3", "tool_shift"])
    fitted = identify(data)
    assert fitted.noise_scale > 1.5
    brute = Brute(fitted)
    assert brute.space.rss == pytest.approx(brute.rss(), rel=1e-7)


def test_evidence_counts_its_tries() -> None:
    one = p_value(30.0, 2, 300.0, 500, 1)
    assert 0.0 < one < 1e-10
    assert p_value(30.0, 2, 300.0, 500, 1000) == pytest.approx(1000.0 * one)
    assert p_value(0.0, 2, 300.0, 500, 1) == 1.0
    assert p_value(30.0, 0, 300.0, 500, 1) == 1.0
    assert p_value(30.0, 3, 300.0, 3, 1) == 1.0
    assert evidence_of(30.0, 11.0, 300.0, 600, 1000) == pytest.approx(
        600.0 * np.log(300.0 / 270.0) - 11.0 - 2.0 * np.log(1000.0)
    )


def test_evidence_of_an_effect_is_the_same_inside_and_outside_the_model(
    complete: tuple[Dataset, IdentificationFit],
) -> None:
    """The score of an effect inside the model, from its covariance, equals that outside it."""
    data, fitted = complete
    effect = periodic(2, 7.0)
    outside = library(fitted, Space.of(fitted))
    index = next(i for i, f in enumerate(outside.families) if f.label == "periodic:j2")
    place = outside.families[index].place_of(effect)
    gain, freedom = outside.gains(index)
    before = outside.at(index, place, float(gain[place]), int(freedom[place]))
    whole = refit(data, fitted, (effect,))
    scores = library(whole, Space.of(whole))
    without, own_gain, _ = leave_one_out(Space.of(whole), scores, effect)
    assert without.own(effect, own_gain) == pytest.approx(before.evidence, abs=0.5)


def test_the_chance_of_a_claim_is_that_of_the_f_test(tmp_path: Path) -> None:
    """In noise alone, p-values of fixed candidates are uniform enough: half are below one half."""
    chances = []
    for seed in range(200, 208):
        _, data = simulate(tmp_path / str(seed), seed=seed, n=60, n_validation=0, effects=[])
        fitted = identify(data)
        scores = library(fitted, Space.of(fitted))
        for index, family in enumerate(scores.families):
            if family.label.startswith("backlash:"):
                gain, freedom = scores.gains(index)
                chances.append(p_value(float(gain[0]), int(freedom[0]), scores.rss, scores.freedom, 1))
    assert len(chances) == 48
    assert 0.25 < np.mean(np.array(chances) < 0.5) < 0.75
    assert min(chances) > 1e-5
