"""Test positions with an uncertainty, and their treatment by a fit.

These would catch: a position that is fitted as if it were exact or free, a displaced cup that is not named or that
accuses its neighbours, and an alarm over cups as good as stated. They would also catch an uncertainty that goes to
another name, and one that is not stated and passes without a warning.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import DataError, IdentificationFit, identify
from calib.arm.start import align
from calib.fit import TargetOffset, judge_points, offsets_of
from tests.benchmarks.nests import data_sets, example, judged_mm, study, truth_of
from tests.calib.cells import NOISE, POSE, Cell

U_MM = 0.05


class Declared:
    """Cell with distances to four base targets.

    Each declared position is off by a draw of `U_MM` per axis.
    """

    def __init__(self, seed: int = 1) -> None:
        self.cell = Cell(seed, POSE)
        self.cell.measure("l", 200, noise=NOISE, validation=0)
        self.declared = {b: p + self.cell.rng.normal(0.0, U_MM, 3) for b, p in self.cell.base_targets.items()}

    def identified(self, folder: Path, **more: Any) -> IdentificationFit:
        places = {b: p.tolist() for b, p in self.declared.items()}
        header = {"base_targets": places, "base_targets_u_mm": U_MM} | more
        return identify(self.cell.dataset(folder, **header))


def named(found: IdentificationFit) -> dict[str, TargetOffset]:
    return {offset.name: offset for offset in offsets_of(found)}


def test_one_out_of_place_is_named_and_no_other(tmp_path: Path) -> None:
    set_up = Declared()
    set_up.declared["B2"] = set_up.declared["B2"] + [0.4, -0.3, 0.3]
    found = set_up.identified(tmp_path)
    offsets = named(found)
    assert [name for name, offset in offsets.items() if offset.judged.doubted] == ["B2"]
    assert offsets["B2"].judged.distance_mm == pytest.approx(0.58, abs=0.2)
    assert offsets["B2"].judged.rivals == ()
    assert found.warnings[0] == offsets["B2"].in_words()
    assert found.warnings[0].startswith("Base target B2 lies 0.")
    assert found.warnings[0].endswith("sigma) from where the cell file puts it to 0.05 mm: measure it anew.")


def test_what_the_others_say_is_what_a_fit_without_its_own_position_says(tmp_path: Path) -> None:
    set_up = Declared(2)
    set_up.declared["B3"] = set_up.declared["B3"] + [0.0, 0.5, 0.0]
    judged = named(set_up.identified(tmp_path / "1"))["B3"].judged
    u_mm = dict.fromkeys(set_up.declared, U_MM) | {"B3": 1e4}
    without = set_up.identified(tmp_path / "2", base_targets_u_mm=u_mm)
    at = [without.model.index[f"B3.{axis}"] for axis in "xyz"]
    offset, spread = without.estimate[at], without.covariance[np.ix_(at, at)] + U_MM**2 * np.eye(3)
    assert judged.distance_mm == pytest.approx(np.linalg.norm(offset), rel=1e-3)
    # the two fits found noise that differs by a percent
    assert judged.sigma == pytest.approx(np.sqrt(offset @ np.linalg.solve(spread, offset)), rel=0.02)


def test_positions_as_good_as_stated_are_not_doubted(tmp_path: Path) -> None:
    squares = []
    for seed in range(3, 9):
        offsets = named(Declared(seed).identified(tmp_path / str(seed)))
        assert set(offsets) == {"B1", "B2", "B3", "B4"}
        assert not any(offset.judged.doubted for offset in offsets.values())
        squares += [offset.judged.sigma**2 for offset in offsets.values()]
    assert 1.0 < np.mean(squares) < 5.0, "chi-squared with up to three degrees of freedom each"


def test_by_name_one_is_free_within_its_own_and_the_rest_exact(tmp_path: Path) -> None:
    set_up = Declared()
    set_up.declared |= {b: set_up.cell.base_targets[b] for b in ("B1", "B3", "B4")}
    set_up.declared["B2"] = set_up.cell.base_targets["B2"] + [0.3, 0.0, 0.0]
    found = set_up.identified(tmp_path, base_targets_u_mm={"B2": 0.3, "B4": 0.0})
    offsets = named(found)
    assert list(offsets) == ["B2"]
    np.testing.assert_allclose(offsets["B2"].offset_mm, [-0.3, 0.0, 0.0], atol=0.02)
    assert 0.8 < found.noise_scale < 1.2


@pytest.mark.parametrize("fit", [["base", "geometry"], ["base", "geometry", "tool"]])
def test_tool_targets_are_weighed_with_and_without_their_group(fit: list[str], tmp_path: Path) -> None:
    cell = Cell(4, POSE)
    cell.soft[:] = 0.0
    cell.add["beta3"] = 0.0
    cell.targets["T2"] = cell.targets["T2"] + [0.5, 0.0, -0.4]
    cell.measure("p", 150, noise=NOISE, validation=0)
    u_mm = {"T1": 0.02, "T2": 0.02, "T3": 0.02}
    found = identify(cell.dataset(tmp_path, model={"fit": fit}, tool_targets_u_mm=u_mm))
    offsets = named(found)
    assert [name for name, offset in offsets.items() if offset.judged.doubted] == ["T2"]
    assert offsets["T2"].kind == "tool target"
    assert offsets["T2"].judged.distance_mm == pytest.approx(0.64, abs=0.1)
    assert found.noise_scale < 1.2


def test_a_cup_and_its_neighbour_that_explain_alike_are_both_named(tmp_path: Path) -> None:
    """A cup and its neighbour that explain the readings alike are both named.

    Three cups show the three sides of their triangle: either end may be the cause of a longer side.
    """
    _, sets = data_sets(9, tmp_path, cups_u_mm=0.02)
    offsets = named(identify(sets["uncertain"]))
    doubted = {name: offset.judged.rivals for name, offset in offsets.items() if offset.judged.doubted}
    assert doubted == {"B3": ("B2",)}
    assert (
        offsets["B3"]
        .in_words()
        .endswith(
            "to 0.02 mm, or else B2, which these readings hardly distinguish from it: measure them anew."
        )
    )


def test_points_are_judged_by_the_frame_of_the_others() -> None:
    """With one noise for all, a point is judged by the rigid fit to the others."""
    rng = np.random.default_rng(7)
    stated = rng.uniform(-500.0, 500.0, (4, 3))
    turn = Rotation.from_rotvec([0.4, -2.0, 1.1]).as_matrix()
    true = stated + rng.normal(0.0, 0.05, (4, 3)) + [[0.0] * 3, [0.3, 0.0, -0.4], [0.0] * 3, [0.0] * 3]
    seen = (true - [100.0, 2000.0, -50.0]) @ turn + rng.normal(0.0, 0.01, (4, 3))
    judged = judge_points(
        seen, stated, np.full(4, 0.05), np.tile(1e-4 * np.eye(3), (4, 1, 1)), ["A", "B", "C", "D"]
    )
    assert [one.doubted for one in judged] == [False, True, False, False]
    others = [0, 2, 3]
    back, shift = align(seen[others], stated[others], np.ones(3))
    left = seen[1] @ back.T + shift - stated[1]
    assert judged[1].distance_mm == pytest.approx(np.linalg.norm(left), rel=1e-3)


def test_points_as_good_as_stated_are_doubted_once_in_a_thousand() -> None:
    rng = np.random.default_rng(8)
    stated = np.array([[0.0, 0.0, 0.0], [600.0, 0.0, 0.0], [0.0, 600.0, 0.0]])
    u_mm, noise = np.array([0.02, 0.05, 0.1]), np.tile(np.diag([1e-4, 4e-4, 9e-4]), (3, 1, 1))
    squares, doubted = [], 0
    for _ in range(1000):
        off = u_mm[:, None] * rng.normal(size=(3, 3)) + np.array([0.01, 0.02, 0.03]) * rng.normal(size=(3, 3))
        judged = judge_points(stated + off, stated, u_mm, noise, ["N1", "N2", "N3"])
        squares += [one.sigma**2 for one in judged]
        doubted += any(one.doubted for one in judged)
    assert np.mean(squares) == pytest.approx(2.0, abs=0.15), "in their plane, not across it"
    assert doubted <= 5


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"base_targets_u_mm": {"B22": 0.1}}, "base_targets_u_mm.B22.*no position.*Did you mean 'B2'"),
        ({"tool_targets_u_mm": {"X": 0.1}}, "tool_targets_u_mm.X.*no position"),
        ({"tool_targets_u_mm": {"T1": -0.1}}, "tool_targets_u_mm.T1.*zero or above"),
        ({"tool_targets_u_mm": {"T1": 1e-30}}, "tool_targets_u_mm.T1.*too small to be true"),
        ({"tool_targets_u_mm": "good"}, "tool_targets_u_mm.*zero or above"),
        ({"tool_target_u_mm": 0.1}, "tool_target_u_mm.*Did you mean 'tool_targets_u_mm'"),
        ({"u_mm_assumed": "B1"}, "u_mm_assumed.*list of names"),
    ],
)
def test_refused(header: dict[str, Any], words: str, tmp_path: Path) -> None:
    cell = Cell()
    cell.measure("l", 3)
    with pytest.raises(DataError, match=words):
        cell.dataset(tmp_path, **header)


def test_what_was_assumed_is_said(tmp_path: Path) -> None:
    found = Declared().identified(tmp_path, base_targets_u_mm=0.5, u_mm_assumed=["B1", "B4"])
    (said,) = [warning for warning in found.warnings if "Nobody stated" in warning]
    assert "B1 (0.5 mm), B4 (0.5 mm), assumed" in said
    assert "u_mm" in said


def test_cups_out_of_place_cost_nothing_but_the_place_of_the_world(tmp_path: Path) -> None:
    """Cups with a stated uncertainty cost little when they are displaced by 0.3 mm.

    This is the ballbar example (`python -m tests.benchmarks nests` judges twenty). If the cups are taken as exact,
    they bend the arm, and the diagnosis reports that they, or the balls, are elsewhere. With a stated uncertainty,
    and their triangle measured or not, they cost next to nothing.
    """
    found = study(3, tmp_path)
    error_mm = {name: error for name, (_, error) in found.items()}
    cell, visits = example()
    world = truth_of(cell, 3).world
    bent, right = (judged_mm(found[name][0].base, world, cell, visits) for name in ("exact", "as they are"))
    assert bent > 10.0 * right
    assert found["exact"][0].verdict in ("ambiguous", "unexplained")
    assert error_mm["uncertain"] < 0.05
    assert error_mm["sides"] < 1.1 * error_mm["as they are"]
    labels = {name: [f.effect.label for f in diagnosis.effects] for name, (diagnosis, _) in found.items()}
    assert any(label.startswith("base_target_shift") for label in labels["exact"])
    assert labels["uncertain"] == labels["sides"] == []
    assert found["uncertain"][0].verdict == "complete"
