"""Columns whose meaning a person states, against what their names tell.

These would catch: a statement that leaves what was read before in the map, a unit that is kept from another column, and
a quantity that no column is any more without anybody being told.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from calib import DataError
from calib.foreign import MapProposal, answers_of, converted, propose
from calib.units import DEG
from tests.calib.exports import CASES, ROBOT, TRUTH
from tests.calib.exports.case import BODY, HEAD, grid, named, save

WORDS = ["alpha", "beta", "gamma", "delta", "eps", "zeta", "east", "north", "up"]
STATED = [
    f"column.{word}={quantity}"
    for word, quantity in zip(WORDS, [*(f"j{k}" for k in range(1, 7)), *"xyz"], strict=True)
]


def table(folder: Path, names: Sequence[str]) -> Path:
    return save(folder / "a.csv", named(names, [[f"{value:.6f}" for value in row] for row in BODY]))


def proposal(file: Path, *texts: str) -> MapProposal:
    return propose([file], {"robot": ROBOT, **answers_of(texts, "--answer")})


def test_names_that_say_nothing_are_said_by_the_user(tmp_path: Path) -> None:
    file = table(tmp_path, WORDS)
    assert len(proposal(file).missing) == 2
    stated = proposal(file, *STATED)
    assert stated.complete, stated
    assert stated.made.files[0].columns["j3"] == "gamma[deg]"
    assert stated.made.files[0].columns["x"] == "east[mm]"  # the robot decided the unit
    found = converted(stated.made, [file], "map.toml", tmp_path)
    assert found.fit is not None
    assert found.fit.miss < 1.0
    np.testing.assert_allclose(np.array(found.table.columns["j2_deg"], float), TRUTH.joints[:, 1], atol=1e-5)


def test_the_unit_is_that_of_the_column_that_is_stated(tmp_path: Path) -> None:
    """Joints in degrees are read by their names; the user wants those in radians."""
    rows = [
        [*row[:6], *(f"{value:.9f}" for value in TRUTH.joints[i] * DEG), *row[6:]]
        for i, row in enumerate(grid(BODY))
    ]
    file = save(tmp_path / "a.csv", named([*HEAD[:6], *(f"w{k} [rad]" for k in "abcdef"), *HEAD[6:]], rows))
    stated = proposal(file, *(f"column.w{letter} [rad]=j{k}" for k, letter in enumerate("abcdef", start=1)))
    assert stated.made.files[0].columns["j6"] == "wf [rad][rad]"
    aside = [each for each in stated.parts[0].findings if each.column.startswith("J")]
    assert {(each.read_as, each.why) for each in aside} == {
        ("", "another column is read in its place, as answered")
    }


def test_exchanged_columns_are_exchanged(tmp_path: Path) -> None:
    names = [*HEAD[:6], "Y [mm]", "X [mm]", "Z [mm]"]
    file = table(tmp_path, names)
    stated = proposal(file, "column.Y [mm]=x", "column.X [mm]=y")
    fit = converted(stated.made, [file], "map.toml", tmp_path).fit
    assert fit is not None
    assert fit.miss < 1.0


@pytest.mark.parametrize(
    ("texts", "missing"),
    [
        (("column.X [mm]=y",), ("a column for x",)),
        (("column.J1 [deg]=j2",), ("a column for j1",)),
        (("column.J3 [deg]=leave",), ("joint angles",)),
        (("column.Z [mm]=leave",), ("measured coordinates",)),
        (("column.Z [mm]=id",), ("measured coordinates",)),
    ],
)
def test_what_no_column_is_any_more_is_missed(
    texts: tuple[str, ...], missing: tuple[str, ...], tmp_path: Path
) -> None:
    found = proposal(table(tmp_path, HEAD), *texts)
    assert not found.complete
    assert [any(each.startswith(of) for each in found.missing) for of in missing] == [True] * len(missing)


def test_one_point_may_be_taken_where_several_targets_are_read(tmp_path: Path) -> None:
    (file,) = next(case for case in CASES if case.name == "targets_wide").write(tmp_path)
    before = proposal(file)
    first = next(iter(before.made.files[0].targets.values()))
    names = [first[axis].rpartition("[")[0] for axis in "xyz"]
    stated = proposal(file, *(f"column.{name}={axis}" for name, axis in zip(names, "xyz", strict=True)))
    assert len(before.made.files[0].targets) > 1
    assert not stated.made.files[0].targets
    assert {axis: stated.made.files[0].columns[axis] for axis in "xyz"} == dict(first)


def test_names_and_conditions_are_stated_too(tmp_path: Path) -> None:
    rows = [[f"N{i}", *row] for i, row in enumerate(grid(BODY))]
    file = save(tmp_path / "a.csv", named(["Operator", *HEAD], rows))
    assert "id" not in proposal(file).made.files[0].columns
    assert proposal(file, "column.Operator=id").made.files[0].columns["id"] == "Operator"
    assert proposal(file, "column.Operator=target").made.files[0].columns["target"] == "Operator"


def test_an_answer_about_a_column_is_divided_at_its_last_mark() -> None:
    assert answers_of(["column.a=b=x", "2.column.=y", "status=ok=1"], "") == {
        "column.a=b": "x",
        "2.column.": "y",
        "status": "ok=1",
    }
    with pytest.raises(DataError, match="is not an answer"):
        answers_of(["column.x="], "--answer")
