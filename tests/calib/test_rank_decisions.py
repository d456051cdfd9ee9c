"""Test which parameters the readings determine, on columns that are plain numbers.

These would catch: the wrong one of two confounded parameters dropped, and a threshold that moved. They would also
catch a decision about the base model that an effect overturns, and substitutes with the wrong share.
"""

from __future__ import annotations

import numpy as np
import pytest

from calib.data.spans import Span
from calib.fit.least_squares import DroppedParameter, _enough_numbers, find_dependent
from tests.calib.toy import columns_of, linear, parameter, toy, toy_model

RNG = np.random.default_rng(6)
AXES = np.linalg.qr(RNG.normal(size=(20, 12)))[0]  # columns of length 1, each at right angles to all others


def decided(model, *columns, settled=None):
    """Names that are kept, and the dropped ones by name."""
    active, dropped = find_dependent(columns_of(model, np.column_stack(columns)), settled)
    kept = [p.name for p, stays in zip(model.parameters, active, strict=True) if stays]
    return kept, {drop.name: drop for drop in dropped}


def test_the_later_of_two_goes_and_the_earlier_stands_in() -> None:
    model = toy_model([parameter("a", 1.0), parameter("b", 1.0), parameter("c", 1.0)])
    kept, gone = decided(model, 3.0 * AXES[:, 0], 6.0 * AXES[:, 0], AXES[:, 1])
    assert kept == ["a", "c"]
    assert gone["b"].confounded_with == ("a",)
    assert [name for name, _ in gone["b"].stand_ins] == ["a"]
    assert gone["b"].stand_ins[0][1] == pytest.approx(2.0)


def test_one_without_a_usual_size_stays() -> None:
    kept, gone = decided(toy_model([parameter("j", 1.0), parameter("base")]), AXES[:, 0], 50.0 * AXES[:, 0])
    assert kept == ["base"]
    assert gone["j"].stand_ins == (("base", pytest.approx(0.02)),)
    kept, _ = decided(toy_model([parameter("x"), parameter("y")]), AXES[:, 0], 50.0 * AXES[:, 0])
    assert kept == ["x"]


@pytest.mark.parametrize(
    ("times", "sizes", "stays"),
    [
        (9.5, (1.0, 1.0), "a"),
        (10.5, (1.0, 1.0), "b"),
        (2.0, (1.0, 10.0), "b"),  # b's usual size is ten times as much
        (50.0, (10.0, 1.0), "a"),
    ],
)
def test_what_would_go_ten_times_its_usual_size_is_given_up(times, sizes, stays) -> None:
    model = toy_model([parameter("a", sizes[0]), parameter("b", sizes[1])])
    kept, gone = decided(model, 3.0 * AXES[:, 0], 3.0 * times * AXES[:, 0])
    assert kept == [stays]
    other = "b" if stays == "a" else "a"
    assert gone[other].stand_ins == ((stays, pytest.approx(times if stays == "a" else 1.0 / times)),)


def test_the_most_strained_of_several_is_given_up() -> None:
    model = toy_model([parameter(name, 1.0) for name in "abcd"])
    last = 20.0 * AXES[:, 0] + 90.0 * AXES[:, 1] + 2.0 * AXES[:, 2]
    kept, gone = decided(model, AXES[:, 0], AXES[:, 1], AXES[:, 2], last)
    assert kept == ["a", "c", "d"]
    assert dict(gone["b"].stand_ins) == {
        "a": pytest.approx(-20 / 90),
        "c": pytest.approx(-2 / 90),
        "d": pytest.approx(1 / 90),
    }


def test_strain_is_no_matter_where_nothing_has_a_usual_size() -> None:
    """A third column, 100 times the difference of two nearly parallel ones, is kept.

    A fourth column has no part in it.
    """
    x, y, z = np.eye(6)[:3]  # exact, so that the share of what has no part is 0 and not nearly 0
    model = toy_model([parameter(name) for name in "abcd"])
    kept, _ = decided(model, x, x + 0.01 * y, z, y)
    assert kept == ["a", "b", "c"]


@pytest.mark.parametrize(("left", "stays"), [(0.7e-7, False), (1.4e-7, True)])
def test_a_column_is_dependent_below_one_part_in_ten_million(left: float, stays: bool) -> None:
    model = toy_model([parameter("a", 1.0), parameter("b", 1.0)])
    kept, _ = decided(model, AXES[:, 0], AXES[:, 0] + left * AXES[:, 1])
    assert kept == (["a", "b"] if stays else ["a"])
    known = toy_model([parameter("a"), parameter("b", 1.0 / left, measured=True)])
    kept, _ = decided(known, AXES[:, 0], AXES[:, 0])
    assert kept == (["a", "b"] if stays else ["a"])


@pytest.mark.parametrize(
    ("length", "size", "stays"),
    [(0.7e-6, 1.0, False), (1.4e-6, 1.0, True), (0.5, 1.0, True), (1e-4, 1e4, True)],
)
def test_a_parameter_that_moves_nothing_is_confounded_with_none(length, size, stays) -> None:
    kept, gone = decided(toy_model([parameter("a"), parameter("b", size)]), AXES[:, 0], length * AXES[:, 1])
    assert kept == (["a", "b"] if stays else ["a"])
    assert list(gone.values()) == ([] if stays else [DroppedParameter("b", ())])


def test_one_that_moves_nothing_beside_one_that_is_confounded() -> None:
    model = toy_model([parameter(name, 1.0) for name in "abc"])
    kept, gone = decided(model, 0.0 * AXES[:, 0], AXES[:, 1], AXES[:, 1])
    assert kept == ["b"]
    assert list(gone) == ["a", "c"]
    assert gone["a"] == DroppedParameter("a", ())
    assert gone["c"].confounded_with == ("b",)


def test_a_prior_that_is_a_measurement_determines() -> None:
    for measured, wanted in ((True, ["a", "b"]), (False, ["a"])):
        model = toy_model([parameter("a"), parameter("b", 2.0, measured=measured)])
        assert decided(model, AXES[:, 0], AXES[:, 0])[0] == wanted


def test_usual_sizes_determine_where_there_are_too_few_numbers() -> None:
    """Three parameters, two readings of one number each; the free one is determined by no size."""
    model = toy_model([parameter("a"), parameter("b", 1.0), parameter("c", 1.0)])
    matrix = np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    assert decided(model, *matrix.T)[0] == ["a", "b", "c"]
    assert decided(model, *np.vstack([matrix, 0.0 * matrix[:1]]).T)[0] == ["a"]


def test_a_measured_distance_determines() -> None:
    of = {"anchors": {"p": (0.0, 0.0, 0.0), "q": (100.0, 0.0, 0.0)}}
    for spans, wanted in (((), ["a"]), ((Span("d1", "p", "q", "", 100.0, 0.1),), ["a", "q.x"])):
        model = toy_model([parameter("a"), parameter("q.x")], spans=spans, **of)
        assert decided(model, AXES[:, 0], AXES[:, 0])[0] == wanted


def test_the_six_heaviest_are_named_and_all_stand_in() -> None:
    """The six heaviest shares (1, 0.9 and so on) are named.

    Shares below a twentieth of the largest one are not mentioned.
    """
    model = toy_model([parameter(name) for name in "abcdefgh"] + [parameter("z", 1.0)])
    weights = np.array([0.4, 1.0, 0.5, 0.9, 0.8, 0.0, 0.7, 0.6])
    kept, gone = decided(model, *(2.0 * AXES[:, :8]).T, AXES[:, :8] @ weights)
    assert kept == list("abcdefgh")
    assert gone["z"].confounded_with == ("b", "d", "e", "g", "h", "c")
    moves = dict(gone["z"].stand_ins)
    assert list(moves) == list("abcdegh")
    assert moves["a"] == pytest.approx(0.2)


def test_what_has_a_twentieth_of_the_largest_share_is_named() -> None:
    model = toy_model([parameter(name) for name in "abcdef"] + [parameter("z", 1.0)])
    weights = np.array([1.0, 1.0, 1.0, 1.0, 0.07, 0.03])
    _, gone = decided(model, *AXES[:, :6].T, AXES[:, :6] @ weights)
    assert sorted(gone["z"].confounded_with) == list("abcde")


def test_what_was_settled_is_not_overturned() -> None:
    """An effect that asks a base parameter to change by 100 times its size is dropped itself.

    The base model is settled; its dropped parameters stay dropped.
    """
    model = toy_model([parameter("a", 1.0), parameter("b", 1.0), parameter("c", 1.0, base=False)])
    columns = (AXES[:, 0], AXES[:, 1], 100.0 * AXES[:, 0])
    assert decided(model, *columns)[0] == ["b", "c"]
    before = DroppedParameter("b", ("elsewhere",), (("a", 7.0),))
    kept, gone = decided(model, *columns, settled=(before,))
    assert kept == ["a"]
    assert gone["b"] is before
    assert gone["c"].stand_ins == (("a", pytest.approx(100.0)),)


def test_an_effect_that_was_dropped_before_is_looked_at_again() -> None:
    model = toy_model([parameter("a", 1.0), parameter("c", 1.0, base=False)])
    kept, _ = decided(model, AXES[:, 0], AXES[:, 1], settled=(DroppedParameter("c", ("a",)),))
    assert kept == ["a", "c"]


def test_settled_ones_that_are_alike_both_stay_and_share_what_goes() -> None:
    model = toy_model([parameter("a", 1.0), parameter("b", 1.0), parameter("c", 1.0, base=False)])
    kept, gone = decided(model, AXES[:, 0], AXES[:, 0], AXES[:, 0], settled=())
    assert kept == ["a", "b"]
    assert dict(gone["c"].stand_ins) == {"a": pytest.approx(0.5), "b": pytest.approx(0.5)}


@pytest.mark.parametrize(
    ("joints", "freedom", "count", "enough"),
    [
        ([0, 1], [3, 3], 6, True),
        ([0, 1], [3, 3], 7, False),
        ([0, 1], [1, 3], 4, True),
        ([0, 1], [1, 3], 5, False),
        ([0, 1, 1, 1], [3, 3, 3, 3], 6, True),
        ([0, 1, 1, 1], [3, 3, 3, 3], 7, False),
        ([0, 1, 1], [3, 1, 3], 5, False),
    ],
)
def test_numbers_of_different_readings_are_counted(joints, freedom, count, enough) -> None:
    """A pose that is measured again brings nothing new."""
    model = toy_model([parameter("a")])
    n = len(joints)
    at = toy(
        model,
        np.zeros((3, n)),
        lambda a: np.zeros(3 * n),
        lambda a: np.zeros((3 * n, 1)),
        np.zeros(1),
        freedom,
    )
    vars(at.design.conditions).update(pose=np.array(joints), joints=np.array(joints)[:, None] * 1.0)
    assert _enough_numbers(at, count) is enough


def test_another_target_at_the_same_pose_is_another_reading() -> None:
    at = linear(toy_model([parameter("a")]), np.zeros((6, 1)), np.zeros((3, 2)))
    same = {"pose": np.zeros(2, dtype=int), "joints": np.zeros((2, 6))}
    vars(at.design.conditions).update(same)
    assert not _enough_numbers(at, 6)
    for field in ("target", "anchor", "series"):
        vars(at.design.conditions).update({**same, field: np.arange(2)})
        assert _enough_numbers(at, 6)
        vars(at.design.conditions).update({field: np.zeros(2, dtype=int)})
