"""Test the world frame.

These would catch: a frame whose axes or handedness are wrong, a transform that is its own inverse, a fit with a
larger residual than necessary, and a corrected triangle with other sides, or at another place, than in the thesis.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from calib import DataError
from calib.arm import WorldFrame, by_three_two_one, frame_of, of_base_points
from calib.arm.world_frame import corrected_triangle, fitted

FILE = json.loads(
    (Path(__file__).parent.parent / "vectors" / "world_frame_correction.json").read_text("utf-8")
)
angles, lengths = st.floats(-3.0, 3.0), st.floats(-5000.0, 5000.0)
NESTS = np.array([[0.0, 0, 0], [600, 0, 0], [0, 600, 0], [500, 400, 120], [-200, 300, 40]])


def pose(turn: tuple[float, ...], place: tuple[float, ...]) -> WorldFrame:
    return WorldFrame(Rotation.from_rotvec(turn).as_matrix(), np.array(place))


@given(st.tuples(angles, angles, angles), st.tuples(lengths, lengths, lengths), st.integers(3, 5))
def test_both_ways_recover_where_the_instrument_stands(
    turn: tuple[float, ...], place: tuple[float, ...], count: int
) -> None:
    truth = pose(turn, place)
    measured = truth.to_tracker(NESTS[:count])
    found, left = fitted(measured, NESTS[:count])
    for frame in (found, by_three_two_one(measured[:3], NESTS[:3])):
        np.testing.assert_allclose(frame.rotation, truth.rotation, rtol=0, atol=1e-9)
        np.testing.assert_allclose(frame.to_world(measured), NESTS[:count], rtol=0, atol=1e-6)
    assert np.abs(left).max() < 1e-8


def test_a_fit_leaves_the_least_and_says_what() -> None:
    """Against a general minimiser, and smaller than what 3-2-1 leaves."""
    rng = np.random.default_rng(2)
    truth = pose((0.3, -0.2, 2.0), (900.0, -400.0, 50.0))
    measured = truth.to_tracker(NESTS) + rng.normal(0.0, 0.1, NESTS.shape)
    found, left = fitted(measured, NESTS)

    def cost(x: Any) -> float:
        frame = WorldFrame(Rotation.from_rotvec(x[:3]).as_matrix() @ truth.rotation, truth.origin + x[3:])
        return float(np.sum((frame.to_world(measured) - NESTS) ** 2))

    options = {"xatol": 1e-9, "fatol": 1e-14, "maxiter": 20000, "maxfev": 40000}
    best = minimize(cost, np.zeros(6), method="Nelder-Mead", options=options)
    assert np.sum(left**2) == pytest.approx(best.fun, rel=1e-6)
    np.testing.assert_allclose(left, found.to_world(measured) - NESTS, rtol=0, atol=0)
    by_hand = by_three_two_one(measured[:3], NESTS[:3]).to_world(measured) - NESTS
    assert np.sum(left**2) < np.sum(by_hand**2)


def test_too_few_nests_or_a_line() -> None:
    line = np.array([[0.0, 0, 0], [1, 2, 3], [2, 4, 6], [3, 6, 9]])
    for nests in (NESTS[:2], line):
        with pytest.raises(DataError, match=r"span no frame.*three or more"):
            fitted(nests, nests)
    with pytest.raises(ValueError, match="line"):
        by_three_two_one(line[:3], NESTS[:3])


@pytest.mark.parametrize("case", range(len(FILE["vectors"])))
def test_the_correction_of_the_thesis(case: int) -> None:
    vector = FILE["vectors"][case]
    found = corrected_triangle(np.array(vector["p"]), vector["d12_d23_d31"])
    np.testing.assert_allclose(found.points, vector["q"], rtol=0, atol=FILE["tol"])
    np.testing.assert_allclose([*found.shift, found.angle], vector["x_y_phi"], rtol=0, atol=FILE["tol"])


@given(
    st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6),
    st.tuples(*[st.floats(298.0, 302.0)] * 3),
    angles,
)
def test_the_corrected_triangle_has_the_sides_and_lies_closest(
    off: list[float], sides: tuple[float, float, float], turn: float
) -> None:
    touched = np.array([[0.0, 0.0], [300.0, 0.0], [150.0, 260.0]]) + np.reshape(off, (3, 2))
    c, s = np.cos(turn), np.sin(turn)
    touched = touched @ np.array([[c, s], [-s, c]]) + [700.0, -200.0]
    found = corrected_triangle(touched, sides)
    q = found.points
    apart = [np.linalg.norm(q[i] - q[j]) for i, j in ((0, 1), (1, 2), (2, 0))]
    np.testing.assert_allclose(apart, sides, rtol=0, atol=1e-9)
    least = np.sum((q - touched) ** 2)
    for small in (-1e-4, 1e-4):
        turned = (q - q.mean(axis=0)) @ np.array([[1.0, small], [-small, 1.0]]) / np.hypot(1.0, small)
        assert np.sum((turned + q.mean(axis=0) - touched) ** 2) >= least
    np.testing.assert_allclose(q.mean(axis=0), touched.mean(axis=0), rtol=0, atol=1e-9)


def test_the_world_of_three_base_points() -> None:
    """If points and bar agree, the world is the frame of the points.

    An error of a side moves no axis upwards.
    """
    table = pose((0.02, -0.01, 1.2), (400.0, 150.0, -30.0))
    cups = np.array([[0.0, 0, 0], [300.0, 0, 0], [150.0, np.sqrt(300.0**2 - 150.0**2), 0]])
    touched = table.to_world(cups)  # robot's frame
    found = of_base_points(touched, [300.0, 300.0, 300.0])
    np.testing.assert_allclose(found.to_world(touched), cups, rtol=0, atol=1e-9)
    longer = of_base_points(touched, [300.6, 300.0, 300.0])
    np.testing.assert_allclose(longer.to_world(touched)[:, 2], 0.0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(longer.rotation.T[:, 2], found.rotation.T[:, 2], rtol=0, atol=1e-12)
    np.testing.assert_allclose(longer.to_world(touched[0]), [0.3, 0.0, 0.0], rtol=0, atol=0.3)
    assert np.linalg.det(longer.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("sides", [(300.0, 100.0, 100.0), (0.0, 300.0, 300.0), (300.0, 600.0, 300.0)])
def test_sides_that_make_no_triangle(sides: tuple[float, float, float]) -> None:
    with pytest.raises(DataError, match="no triangle"):
        corrected_triangle(np.array([[0.0, 0.0], [300.0, 0.0], [150.0, 260.0]]), sides)


def test_frame_of_three_points() -> None:
    rotation, origin = frame_of(np.array([[1.0, 1.0, 1.0], [1.0, 3.0, 1.0], [-4.0, 9.0, 1.0]]))
    np.testing.assert_allclose(rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(origin, [1.0, 1.0, 1.0])


def test_turns_go_into_the_world_with_their_scalar_first() -> None:
    quarter = Rotation.from_rotvec([0.0, 0.0, np.pi / 2.0]).as_matrix()
    frame = WorldFrame(quarter, np.zeros(3))
    np.testing.assert_allclose(
        frame.turned_to_world([[1.0, 0.0, 0.0, 0.0]]), [[np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]], atol=1e-12
    )
