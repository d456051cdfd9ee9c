"""The world frame from three nests."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from acquisition.cell.world_frame import WorldFrame, frame_of, from_nests
from acquisition.errors import NestsDisagree

NESTS = {"N1": (0.0, 0.0, 0.0), "N2": (600.0, 0.0, 0.0), "N3": (0.0, 600.0, 0.0)}
ELSEWHERE = {"A": (100.0, -50.0, 20.0), "B": (400.0, 300.0, 40.0), "C": (-200.0, 500.0, -10.0)}
angles = st.floats(-3.0, 3.0)
lengths = st.floats(-5000.0, 5000.0)


@given(
    st.tuples(angles, angles, angles),
    st.tuples(lengths, lengths, lengths),
    st.sampled_from([NESTS, ELSEWHERE]),
)
def test_recovers_where_the_tracker_stands(
    turn: tuple[float, ...], place: tuple[float, ...], nests: dict[str, tuple[float, ...]]
) -> None:
    truth = WorldFrame(Rotation.from_rotvec(turn).as_matrix(), np.array(place))
    found = from_nests({name: truth.to_tracker(p) for name, p in nests.items()}, nests)
    assert found.rotation == pytest.approx(truth.rotation, abs=1e-9)
    assert found.origin == pytest.approx(truth.origin, abs=1e-6)
    points = np.array([[1.0, 2.0, 3.0], [800.0, -300.0, 500.0]])
    assert found.to_world(truth.to_tracker(points)) == pytest.approx(points, abs=1e-6)
    assert found.to_tracker(found.to_world(points)) == pytest.approx(points, abs=1e-6)
    again = WorldFrame.from_json(found.as_json())
    assert np.array_equal(again.rotation, found.rotation)
    assert np.array_equal(again.origin, found.origin)


def test_origin_x_and_normal() -> None:
    rotation, origin = frame_of(np.array([[1.0, 1.0, 1.0], [1.0, 3.0, 1.0], [-4.0, 9.0, 1.0]]))
    assert origin == pytest.approx([1.0, 1.0, 1.0])
    assert rotation[:, 0] == pytest.approx([0.0, 1.0, 0.0])
    assert rotation[:, 2] == pytest.approx([0.0, 0.0, 1.0])
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_only_direction_matters_of_the_second_and_third_nest() -> None:
    """The 3-2-1 rule ignores an error of N2 along x, or of N3 within the plane."""
    off = dict(NESTS) | {"N2": (600.4, 0.0, 0.0), "N3": (0.3, 600.2, 0.0)}
    found = from_nests(off, NESTS)
    assert found.rotation == pytest.approx(np.eye(3), abs=1e-12)
    assert found.origin == pytest.approx(np.zeros(3), abs=1e-9)


def test_refuses_a_wrong_nest_and_a_line() -> None:
    with pytest.raises(NestsDisagree, match=r"N1 and N2 are 595\.00 mm apart"):
        from_nests(dict(NESTS) | {"N2": (595.0, 0.0, 0.0)}, NESTS)
    with pytest.raises(NestsDisagree, match=r"N1 and N2 are 605\.00 mm apart"):
        from_nests(dict(NESTS) | {"N2": (605.0, 0.0, 0.0)}, NESTS)
    with pytest.raises(ValueError, match="line"):
        frame_of(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]))
