"""Test the ballbar as a 6D instrument: stances of the thesis, and inverted trilateration."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from calib.arm.hexapod import LEGS, stances, trilaterated

THIRDS = np.radians([90.0, 210.0, 330.0])
BASE = 300.0 / np.sqrt(3.0) * np.column_stack([np.cos(THIRDS), np.sin(THIRDS), np.zeros(3)])
TOOL = 150.0 / np.sqrt(3.0) * np.column_stack([np.cos(THIRDS), np.sin(THIRDS), np.zeros(3)]) + [
    0.0,
    0.0,
    100.0,
]


def test_the_stances_of_the_thesis() -> None:
    """There are 144 poses, 72 with all legs away from the flange (Nubiola 4.2)."""
    found = stances(BASE, TOOL, 300.0)
    assert len(found.flange) == 144
    assert found.outward.sum() == 72
    balls = np.einsum("nij,mj->nmi", found.flange[:, :3, :3], TOOL) + found.flange[:, None, :3, 3]
    legs = BASE[found.base] - np.take_along_axis(balls, found.tool[:, :, None], axis=1)
    np.testing.assert_allclose(np.linalg.norm(legs, axis=2), 300.0, atol=1e-9)
    assert np.all(balls[:, :, 2].max(axis=1) > 0.0)


def test_pairs_that_hardly_differ() -> None:
    """Among the 72 poses, 18 pairs hardly differ, so that 54 poses are left (Nubiola 4.2).

    The pairs are closer than 30 deg and 50 mm; all are 8.3 deg apart.
    """
    found = stances(BASE, TOOL, 300.0)
    flange = found.flange[found.outward]
    centre = np.einsum("nij,j->ni", flange[:, :3, :3], TOOL.mean(axis=0)) + flange[:, :3, 3]
    i, j = np.triu_indices(72, 1)
    turn = (
        Rotation.from_matrix(flange[i, :3, :3]).inv() * Rotation.from_matrix(flange[j, :3, :3])
    ).magnitude()
    apart = np.linalg.norm(centre[i] - centre[j], axis=1)
    close = (np.degrees(turn) < 30.0) & (apart < 50.0)
    assert close.sum() == 18
    np.testing.assert_allclose(np.degrees(turn[close]), 8.3, atol=0.05)
    assert len(set(i[close]) | set(j[close])) == 36


@given(
    st.lists(st.permutations(range(3)), min_size=2, max_size=2),
    st.floats(-np.pi, np.pi),
    st.floats(-500.0, 500.0),
)
def test_stances_belong_to_the_balls_whatever_they_are_called(
    names: list[list[int]], turn: float, height: float
) -> None:
    about_z = Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix()
    base = BASE[names[0]] @ about_z.T + [400.0, 10.0, height]
    found = stances(base, TOOL[names[1]], 300.0)
    assert (len(found.flange), found.outward.sum()) == (144, 72)
    pairs = {tuple(sorted(zip(b, t, strict=True))) for b, t in zip(found.base, found.tool, strict=True)}
    assert len(pairs) == 36
    assert all(len(set(each)) == len(LEGS) for each in pairs)


@given(arrays(np.float64, (4, 3), elements=st.floats(-500.0, 500.0)))
def test_trilateration_is_undone_by_distances(points: np.ndarray) -> None:
    v1, v2, v3, p = points[:, None]
    normal = np.cross(v2 - v1, v3 - v1)
    height = np.sum((p - v1) * normal) / max(float(np.linalg.norm(normal)), 1e-9)
    if np.linalg.norm(normal) < 1e3 or np.linalg.norm(v2 - v1) < 10.0 or abs(height) < 10.0:
        return  # a triangle without a plane to speak of, or a point in it
    l1, l2, l3 = (np.linalg.norm(p - v, axis=1) for v in (v1, v2, v3))
    found = trilaterated(v1, v2, v3, l1, l2, l3, np.sign([height]))
    np.testing.assert_allclose(found, p, atol=1e-3)


def test_legs_that_do_not_reach_and_balls_in_a_line() -> None:
    assert len(stances(BASE, TOOL, 150.0).flange) == 0
    line = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [200.0, 0.0, 0.0]])
    for base, tool in ((line, TOOL), (BASE, line)):
        with pytest.raises(ValueError, match="line"):
            stances(base, tool, 300.0)
