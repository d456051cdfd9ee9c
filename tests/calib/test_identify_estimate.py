"""Test the estimate and its reported properties.

These would catch: redundancy that is not found or not named, an estimate that does not minimise the documented
cost, standard errors of the wrong size, and a chain that is evaluated twice.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from calib import Dataset, IdentificationFit, identify, read_dataset
from calib.arm import Frames
from calib.array import Array
from calib.fit.least_squares import usual_sizes
from calib.model import BoundModel
from calib.units import to_internal
from mocks.campaign import make_campaign
from tests.calib.campaigns import simulate, write_files
from tests.calib.cells import NOISE, Cell
from tests.calib.chain import chain


@pytest.mark.parametrize(
    ("robot", "expected"),
    [("abb-irb120", {"d3": {"d2"}}), ("ur10", {"d3": {"d2"}, "d4": {"d2"}, "c6": set()})],
)
def test_redundant_parameters_are_found_and_named(
    robot: str, expected: dict[str, set[str]], tmp_path: Path
) -> None:
    """Parallel axes: sliding along them is one freedom. A UR's last joint carries no load."""
    _, data = simulate(tmp_path, robot, seed=2, n=30, n_validation=0, effects=[])
    result = identify(data)
    assert {drop.name: set(drop.confounded_with) for drop in result.dropped} == expected
    for name, others in expected.items():
        assert any(name in warning and all(o in warning for o in others) for warning in result.warnings)
        position = result.model.index[name]
        assert result.estimate[position] == 0.0
        assert result.standard_errors[position] == 0.0
    active = len(result.estimate) - len(result.dropped)
    assert result.degrees_of_freedom == 3 * len(result.readings.rows) - active
    # told independently: the rank of the derivative of plain matrices
    columns = reference_problem(data, result)["jacobian"](np.zeros(active))
    everything = reference_problem(data, result, drop=False)["jacobian"](np.zeros(len(result.estimate)))
    rows = 3 * len(result.readings.rows)  # without the prior
    lengths = [np.linalg.norm(c[:rows], axis=0) for c in (columns, everything)]
    ranks = [
        int(np.linalg.matrix_rank(c[:rows] / np.maximum(size, 1e-9 * size.max()), tol=1e-6))
        for c, size in zip((columns, everything), lengths, strict=True)
    ]
    assert ranks == [active, active]


def test_what_stands_in_for_another_is_held_to_both_sizes(tmp_path: Path) -> None:
    """A parameter that replaces another has the prior scale of both.

    d3 of an IRB 120 equals d2, each usually 1 mm off, so their sum is 1.41 mm off. No other parameter changes.
    """
    _, data = simulate(tmp_path, "abb-irb120", seed=2, n=30, n_validation=0, effects=[])
    result = identify(data)
    assert [(d.name, [name for name, _ in d.stand_ins if name == "d2"]) for d in result.dropped] == [
        ("d3", ["d2"])
    ]
    sizes = usual_sizes(result.model, result.dropped)
    own = result.model.prior_std.copy()
    own[result.model.index["d2"]] = np.sqrt(2.0)
    finite = np.isfinite(own)
    np.testing.assert_allclose(sizes[finite], own[finite], rtol=1e-6)
    held = result.prior[finite & (result.prior > 0.0)] * own[finite & (result.prior > 0.0)]
    np.testing.assert_allclose(held, held[0], rtol=1e-6)


def test_a_target_on_the_axis_leaves_rank_26(tmp_path: Path) -> None:
    """Thesis: with T1 alone, 26 of the 31 parameters are seen. Ours says so before it fits anything."""
    campaign = make_campaign(seed=2, n=60, n_validation=0, effects=[], targets={"T1": (0.0, 0.0, 125.0)})
    header = {**campaign.header, "model": {"fit": ["base", "geometry", "compliance"]}}
    header["tool_targets"] = {"T1": [0.0, 1.5, 125.0]}  # just far enough off the axis to be let through
    data = read_dataset(write_files(tmp_path, campaign.rows, header))
    result = identify(data)
    assert any("hardly seen" in w for w in result.warnings)


def reference_problem(data: Dataset, result: IdentificationFit, *, drop: bool = True) -> dict[str, Any]:
    """The fit as a textbook would write it: matrices, loops, derivative by complex numbers."""
    model = result.model
    dropped = {d.name for d in result.dropped} if drop else set()
    names = [p.name for p in model.parameters if p.name not in dropped]
    # The prior weighs with the noise that the robust passes found: taken from the result, and looked at.
    size = []
    beside = usual_sizes(model, result.dropped)  # of its own and of those for which it stands in
    for p, weight, widened in zip(model.parameters, result.prior, beside, strict=True):
        usual = to_internal(p.size, p.unit) if p.size else np.inf
        if p.size and p.name not in dropped and p.name not in {d.name for d in result.dropped}:
            assert weight * widened == pytest.approx(result.noise_scale, rel=0.5)
            usual = 1.0 / weight
        if p.name in names:
            size.append(usual)
    rows = result.readings.rows
    noise = data.header.noise
    whiteners, measured = [], data.points[rows]
    for point in measured:
        beam = point - np.array(noise.station_mm)
        distance = np.linalg.norm(beam)
        beam = beam / distance
        along = noise.range_mm + noise.range_ppm * 1e-6 * distance
        across = noise.transverse_mm + noise.transverse_ppm * 1e-6 * distance
        # symmetric root: sums of squares are those of any other root
        whiteners.append(np.eye(3) / across + np.outer(beam, beam) * (1.0 / along - 1.0 / across))
    c = data.conditions

    def point(x: Any, i: int) -> Any:
        add: dict[str, Any] = {}
        for name, value in zip(names, x, strict=True):
            slot, amount = name, value
            if name[0] == "c" and name[1:].isdigit():
                slot, amount = f"theta{name[1:]}", value * c.torque[i, int(name[1:]) - 1]
            add[slot] = add.get(slot, 0.0) + amount
        target = data.header.targets_of("main")[c.target_names[c.target[i]]]
        return chain(model.robot, c.joints[i], add, target)[:3, 3]

    def residual(x: Array) -> Array:
        parts = [w @ (m - point(x, i).real) for w, m, i in zip(whiteners, measured, rows, strict=True)]
        return np.concatenate([*parts, -x / np.array(size)])

    def jacobian(x: Array) -> Array:
        out = []
        for k in range(len(x)):
            step = x.astype(complex)
            step[k] += 1e-30j
            parts = [-w @ point(step, i).imag / 1e-30 for w, i in zip(whiteners, rows, strict=True)]
            out.append(np.concatenate(parts))
        return np.vstack([np.column_stack(out), -np.diag(1.0 / np.array(size))])

    return {"names": names, "residual": residual, "jacobian": jacobian}


@pytest.mark.parametrize("robot", ["abb-irb120", "ur10"])
def test_the_estimate_is_that_of_an_independent_program(robot: str, tmp_path: Path) -> None:
    """The estimate agrees with `scipy.optimize.least_squares` on the documented cost.

    The estimate agrees to 1e-8, the standard errors to 1e-6.
    """
    campaign = make_campaign(
        robot, seed=4, n=20, n_validation=0, effects=[], noise_declared_factor=1.4, repeatability_deg=0.0
    )
    data = read_dataset(write_files(tmp_path, campaign.rows, campaign.header))
    result = identify(data)
    assert result.faulty_rows == ()
    assert result.relabelled_rows == ()
    problem = reference_problem(data, result)
    start = np.zeros(len(problem["names"]))
    size = 1.0 / np.linalg.norm(problem["jacobian"](start), axis=0)
    scaled = least_squares(
        lambda u: problem["residual"](u * size),
        start,
        jac=lambda u: problem["jacobian"](u * size) * size,  # pyright: ignore[reportArgumentType]
        method="lm",
        xtol=1e-10,
        ftol=1e-10,
        gtol=1e-10,
    )
    reference = scaled.x * size
    for _ in range(2):  # MINPACK stops where the cost no longer falls, half the digits of the estimate away
        step, *_ = np.linalg.lstsq(
            problem["jacobian"](reference) * size, problem["residual"](reference), rcond=None
        )
        reference = reference - step * size
    places = [result.model.index[name] for name in problem["names"]]
    columns = problem["jacobian"](reference) * size
    spread = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns))) * size
    left = problem["residual"](reference)[: 3 * len(result.readings.rows)]
    scale = np.sqrt(np.sum(left**2) / (len(left) - len(reference)))
    assert scale < 1.0
    assert result.noise_scale == pytest.approx(scale, rel=1e-7)
    assert np.sum(result.residual**2) == pytest.approx(np.sum(left**2), rel=1e-9)
    np.testing.assert_allclose(result.standard_errors[places], spread, rtol=1e-6)
    # relative to the value, or where the value is nearly nothing, to its standard error
    limit = 1e-8 * np.maximum(np.abs(reference), spread)
    assert np.all(np.abs(result.estimate[places] - reference) < limit), (
        np.abs(result.estimate[places] - reference) / limit
    )


def test_no_chain_is_walked_twice_where_the_fit_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The start and every step of Gauss-Newton evaluate the chain once, with clean readings."""
    _, data = simulate(tmp_path, seed=3, n=50, n_validation=0, effects=[], repeatability_deg=0.0)
    walked: list[bytes] = []
    frames = BoundModel.frames

    def counted(self: BoundModel, estimate: Array, record: Collection[str] | None = None) -> Frames:
        walked.append(estimate.tobytes())
        return frames(self, estimate, record)

    monkeypatch.setattr(BoundModel, "frames", counted)
    result = identify(data)
    assert result.converged
    assert result.faulty_rows == ()
    assert 3 <= len(walked) == len(set(walked)) <= 6


def test_a_gear_softer_than_usual_is_not_held_to_the_usual_size(tmp_path: Path) -> None:
    """A gear ten times softer than usual is not pulled to the usual size.

    Otherwise it was several standard errors short, and effects were named for the rest.
    """
    cell = Cell(1)
    cell.soft[5] = 1e-5
    cell.measure("p", 60, noise=NOISE, validation=0)
    result = identify(cell.dataset(tmp_path))
    i = result.model.index["c6"]
    assert abs(result.estimate[i] - 1e-5) < 4.0 * result.standard_errors[i]
    assert result.standard_errors[i] < 1e-6


def test_standard_errors_are_those_of_repetition(tmp_path: Path) -> None:
    """Parameters of many campaigns scatter about the truth as stated, by chi-square."""
    total, count = 0.0, 0
    for seed in range(100, 116):
        campaign, data = simulate(tmp_path / str(seed), seed=seed, n=60, n_validation=0, effects=[])
        result = identify(data)
        value = dict(zip(result.model.index, result.estimate, strict=True))
        spread = dict(zip(result.model.index, result.standard_errors, strict=True))
        geometry = campaign.world.geometry
        truth = {f"c{k}": campaign.world.compliance[k - 1] for k in range(3, 6)} | {
            "beta3": geometry.beta[2],
            "alpha4": geometry.alpha[3] - result.model.robot.alpha[3],
            "d4": geometry.d[3] - result.model.robot.d[3],
        }
        for name, expected in truth.items():
            total += ((value[name] - expected) / spread[name]) ** 2
            count += 1
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], count)
    # parameters of one campaign are correlated: allow for it by half as much again
    assert low / 1.5 < total < 1.5 * high
