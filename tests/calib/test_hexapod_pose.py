"""Test the direct kinematics of the ballbar hexapod.

These would catch: the sign of an assembly mode exchanged, a length that goes to other balls than its name states,
an uncertainty that omits the triangles, and a pose of legs that do not meet.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calib.arm.hexapod import LENGTHS, MODES, solve_pose, stances
from tests.calib.test_hexapod import BASE, TOOL

VECTORS = Path(__file__).parents[1] / "vectors"
NOMINAL = np.array([300.0] * 9 + [150.0] * 3)
BALLS = {"b": ("B", "B"), "r": ("B", "T"), "t": ("T", "T")}


def odd_lengths(n: int, seed: int = 1) -> NDArray[np.float64]:
    """Draw lengths (n, 12), mm, of hexapods of all sizes near that of the thesis."""
    return NOMINAL + np.random.default_rng(seed).uniform(-15.0, 15.0, (n, 12))


def spans(base: NDArray[np.float64], tool: NDArray[np.float64]) -> NDArray[np.float64]:
    """The twelve distances of balls (3, 3), written down by their names."""
    of = {"B": base, "T": tool}
    return np.array(
        [
            np.linalg.norm(of[BALLS[name[0]][0]][int(name[1]) - 1] - of[BALLS[name[0]][1]][int(name[2]) - 1])
            for name in LENGTHS
        ],
        dtype=np.float64,
    )


def test_the_vectors_of_the_thesis() -> None:
    table = json.loads((VECTORS / "hexapod.json").read_text("utf-8"))
    assert table["legs_order"].startswith(",".join(LENGTHS))
    for case in table["dkp"]:
        poses = solve_pose(case["q"], [1, case["s2"], case["s3"]])
        np.testing.assert_allclose(poses.base[0], case["B"], rtol=0, atol=table["tol_mm"])
        np.testing.assert_allclose(poses.tool[0, 0], case["T"], rtol=0, atol=table["tol_mm"])


def test_the_uncertainty_has_all_twelve_lengths_in_it() -> None:
    """The uncertainty includes all twelve lengths, as in Table 3.1.

    B2, t1 and t2 depend on each other: 3.359, 3.052, 2.886, 3.331 times sigma.
    """
    full = json.loads((VECTORS / "table3_1.json").read_text("utf-8"))
    table = json.loads((VECTORS / "hexapod.json").read_text("utf-8"))
    modes = [[1, *full["solution_signs_s2_s3"][key]] for key in "1234"]
    u = np.sqrt(np.diagonal(solve_pose(NOMINAL, modes).ball_covariance(1.0)[0], axis1=1, axis2=2))
    of_balls = np.linalg.norm(u.reshape(4, 3, 3), axis=2)
    np.testing.assert_allclose(of_balls[:, 2], full["full_GUM_t3"], atol=full["tol"])
    np.testing.assert_allclose(of_balls[:, 0], full["printed"]["t1"], atol=full["tol"])
    expected = [full["printed"]["t2_sol12"]] * 2 + [full["printed"]["t2_sol34"]] * 2
    np.testing.assert_allclose(of_balls[:, 1], expected, atol=full["tol"])
    for row in table["table31"]:
        k = modes.index([1, *row["signs"]])
        np.testing.assert_allclose(u[k].reshape(3, 3), row["u"], atol=table["tol_table"])


def test_against_brute_force_least_squares() -> None:
    """Nine coordinates from nine distances, by a solver that knows nothing of triangles."""
    lengths = odd_lengths(6)
    poses = solve_pose(lengths)
    assert np.isfinite(poses.tool).all()
    rng = np.random.default_rng(2)
    for i, m in np.ndindex(len(lengths), len(MODES)):
        base, start = poses.base[i], poses.tool[i, m] + rng.uniform(-2.0, 2.0, (3, 3))
        found = least_squares(
            lambda x, i=i, base=base: spans(base, x.reshape(3, 3)) - lengths[i],
            start.ravel(),
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        np.testing.assert_allclose(poses.tool[i, m], found.x.reshape(3, 3), rtol=0, atol=1e-10)


def test_all_modes_are_poses_of_their_own() -> None:
    lengths = odd_lengths(20, seed=3)
    poses = solve_pose(lengths)
    for i, m in np.ndindex(*poses.tool.shape[:2]):
        np.testing.assert_allclose(spans(poses.base[i], poses.tool[i, m]), lengths[i], rtol=0, atol=1e-10)
        assert np.sign(poses.tool[i, m, 0, 2]) == MODES[m, 0]
    apart = poses.tool[:, :, None] - poses.tool[:, None]
    most = np.abs(apart).max(axis=(3, 4)) + 1e3 * np.eye(8)
    assert most.min() > 1.0


def test_frames_are_those_of_the_balls() -> None:
    poses = solve_pose(odd_lengths(5, seed=4))
    frames = poses.frames
    turn = frames[..., :3, :3]
    np.testing.assert_allclose(np.linalg.det(turn), 1.0, atol=1e-12)
    own = np.einsum("nmij,nmkj->nmki", turn.swapaxes(-1, -2), poses.tool - frames[..., None, :3, 3])
    np.testing.assert_allclose(own[..., 0, :], 0.0, atol=1e-10)
    np.testing.assert_allclose(own[..., 1, 1:], 0.0, atol=1e-10)
    np.testing.assert_allclose(own[..., 2, 2], 0.0, atol=1e-10)
    assert np.all(own[..., 2, 1] > 0.0)


def test_covariance_is_that_of_lengths_changed_one_by_one() -> None:
    lengths, step = odd_lengths(4, seed=5), 1e-4
    poses = solve_pose(lengths)
    u_mm = np.linspace(0.5e-3, 2e-3, 12)
    derivative = np.zeros((4, 8, 9, 12))
    for k in range(12):
        more, less = (solve_pose(lengths + sign * step * np.eye(12)[k]) for sign in (1.0, -1.0))
        derivative[..., k] = ((more.tool - less.tool) / (2.0 * step)).reshape(4, 8, 9)
    expected = (derivative * u_mm) @ (derivative * u_mm).swapaxes(-1, -2)
    found = poses.ball_covariance(u_mm)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6 * np.abs(expected).max())


def test_a_stance_of_the_tool_is_found_again() -> None:
    """A stance of the tool is found again from legs of one length.

    The first design of each labelling is a set of twelve lengths.
    """
    found = stances(BASE, TOOL, 300.0)
    poses = solve_pose(NOMINAL)
    for flange, base, tool in zip(found.flange, found.base, found.tool, strict=True):
        # legs: B1 to T1, T2, B2 to T1, T2, T3, B3 to T1
        b, t = BASE[base[[0, 2, 5]]], TOOL[tool[[0, 1, 4]]] @ flange[:3, :3].T + flange[:3, 3]
        x = (b[1] - b[0]) / 300.0
        z = np.cross(b[1] - b[0], b[2] - b[0])
        z = z / np.linalg.norm(z)
        there = (t - b[0]) @ np.column_stack([x, np.cross(z, x), z])
        assert np.abs(poses.tool[0] - there).max(axis=(1, 2)).min() < 1e-9


@pytest.mark.parametrize(
    ("name", "length", "modes"),
    [("b12", 700.0, range(8)), ("r31", 900.0, range(8)), ("t23", 900.0, range(8))],
)
def test_legs_that_do_not_meet_make_no_pose_and_spoil_no_other(
    name: str, length: float, modes: range
) -> None:
    lengths = np.tile(NOMINAL, (3, 1))
    lengths[1, LENGTHS.index(name)] = length
    poses = solve_pose(lengths)
    for values in (
        poses.tool,
        poses.frames[..., :3, :],
        poses.ball_covariance(1.0),
    ):
        assert np.isfinite(values[[0, 2]]).all()
        assert np.isnan(values[1, list(modes)]).reshape(len(modes), -1).any(axis=1).all()


@pytest.mark.parametrize(
    ("lengths", "modes"),
    [
        (NOMINAL[:11], MODES),
        (np.where(np.arange(12) == 3, -300.0, NOMINAL), MODES),
        (np.where(np.arange(12) == 3, np.nan, NOMINAL), MODES),
        (NOMINAL, [[1, 1]]),
        (NOMINAL, [[1, 0, 1]]),
    ],
)
def test_refused(lengths: NDArray[np.float64], modes: NDArray[np.float64]) -> None:
    with pytest.raises(ValueError, match=r"twelve lengths above zero|three signs"):
        solve_pose(lengths, modes)
