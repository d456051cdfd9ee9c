"""Measurements as people export them (`tests.calib.exports`): read right, or refused with the right remedy.

These would catch: a separator, decimal, encoding, unit, convention, target or pairing read wrongly, a question that is
guessed in place of asked, and a cell that is passed over in silence.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import DataError
from calib.data import dataset_of, header_of
from calib.foreign import converted, propose, read_map, text_of
from calib.foreign.files.number import notation_of
from calib.text import Columns, parse_toml
from calib.units import DEG
from tests.calib.exports import CASES, ROBOT, TRUTH, Case, N, outcome


def converted_text(case: Case, folder: Path) -> tuple[str, str]:
    """CSV and header of a case, the map kept in a file between proposing and converting. Raises DataError."""
    files = case.write(folder)
    first = propose(files, {"robot": ROBOT, **{k: v for k, v in case.answers.items() if k == "robot"}})
    if first.missing:
        raise DataError(f"no file holds {' and '.join(first.missing)}.", do="Give the file.", file=files[0])
    assert {question.key for question in first.questions} == set(case.asks)
    proposal = propose(files, {**case.answers, "robot": ROBOT}) if case.asks else first
    assert not proposal.questions
    kept = folder / "map.toml"
    kept.write_text(text_of(proposal.made, ["kept"]), encoding="utf-8")
    table = converted(read_map(kept), files, kept, folder).table
    return table.text, table.header


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_a_file_is_read_right_or_refused_with_its_remedy(case: Case, tmp_path: Path) -> None:
    if case.refuses:
        with pytest.raises(DataError, match=case.refuses):
            converted_text(case, tmp_path)
        return
    csv, header = converted_text(case, tmp_path)
    data = dataset_of(
        Columns.of_text(csv, tmp_path / "out.csv"),
        header_of(parse_toml(header, "h"), tmp_path / "out.toml", header),
    )
    row, target = np.repeat(np.arange(N), case.targets), np.tile(np.arange(case.targets), N)
    kept = ~np.isin(row, case.lost_rows)
    row, target = row[kept], target[kept]
    assert len(data) == len(row)
    np.testing.assert_allclose(data.conditions.joints / DEG, joints_of(case)[row], atol=2e-5)
    lost = np.isin(row, case.lost)
    np.testing.assert_allclose(data.points[~lost], TRUTH.points[row, target][~lost], atol=case.within)
    assert np.isnan(data.points[lost]).all()
    assert (data.usable == ~(lost | np.isin(row, case.rejected))).all()
    assert np.isfinite(data.orientation).all() == case.turned
    if case.turned:
        turns = Rotation.from_quat(data.orientation, scalar_first=True)
        assert (turns.inv() * Rotation.from_quat(TRUTH.turns, scalar_first=True)).magnitude().max() < 1e-5
    if case.targets > 1:
        names = np.array(data.conditions.target_names)[data.conditions.target]
        assert names.tolist() == [f"T{t + 1}" for t in target]


def joints_of(case: Case) -> np.ndarray:
    return np.round(TRUTH.joints) if case.name == "thousands_unclear" else TRUTH.joints


def a_map(folder: Path) -> Path:
    """A kept map of a plain file `a.csv`."""
    files = case_of("lost").write(folder)
    kept = folder / "map.toml"
    kept.write_text(text_of(propose(files, {"robot": ROBOT}).made), encoding="utf-8")
    return kept


def case_of(name: str) -> Case:
    return next(case for case in CASES if case.name == name)


def test_a_map_for_another_file_is_refused_with_what_differs(tmp_path: Path) -> None:
    kept, other = a_map(tmp_path), tmp_path / "other.csv"
    text = (tmp_path / "a.csv").read_text("utf-8").replace("X [mm]", "X [m]", 1)
    other.write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=r"it lacks 'X \[mm\]' and has 'X \[m\]' besides"):
        converted(read_map(kept), [other], kept, tmp_path)
    longer = tmp_path / "longer.csv"  # another preamble is no other file
    longer.write_text("Zelle 4\n\n" + (tmp_path / "a.csv").read_text("utf-8"), encoding="utf-8")
    assert len(converted(read_map(kept), [longer], kept, tmp_path).table) == N


@pytest.mark.parametrize(
    ("old", "new", "refused"),
    [
        ('x = "X [mm][mm]"', 'x = "?"', r"undecided: '\?' stands at file 1: columns.x"),
        ('x = "X [mm][mm]"', 'x = "X [mm][deg]"', r"gives x the unit 'deg'"),
        ('x = "X [mm][mm]"', 'x = "X [mm][m]"', r"span .* no robot is measured so"),
        ('x = "X [mm][mm]"', 'x = "X"', r"Write the name of the column and the unit"),
        ('x = "X [mm][mm]"', 'xx = "X [mm][mm]"', r"is no quantity"),
        ('j1 = "J1 [deg][deg]"\n', "", r"has the joints j2_deg"),
        ('robot = "abb-irb120"', 'robot = "ur10"\nrobots = "x"', r"robots|ur10"),
        ('decimal = "."', 'decimal = ","', r"is '[-0-9.]+', not a number"),
    ],
)
def test_a_map_that_cannot_be_meant_is_refused(old: str, new: str, refused: str, tmp_path: Path) -> None:
    kept = a_map(tmp_path)
    text = kept.read_text("utf-8")
    assert old in text
    kept.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(DataError, match=refused):
        read_whole(kept, tmp_path)


def read_whole(kept: Path, folder: Path) -> None:
    """Map, file and data set of `a_map`."""
    table = converted(read_map(kept), [folder / "a.csv"], kept, folder).table
    header = header_of(parse_toml(table.header, "h"), folder / "o.toml", table.header)
    dataset_of(Columns.of_text(table.text, folder / "o.csv"), header)


@pytest.mark.parametrize(
    ("cells", "decimal", "thousands"),
    [
        (["1.5", "2.25"], ".", ""),
        (["1,5", "2,25"], ",", ""),
        (["0,125", "2,250"], ",", ""),  # no thousand begins with 0
        (["1.234,5", "12"], ",", "."),
        (["1,234.5", "12"], ".", ","),
        (["1.234.567", "12"], ",", "."),
        (["1,234", "56"], None, ""),
        (["1,5", "2.5"], None, ""),
        (["10", "20"], ".", ""),
    ],
)
def test_notations(cells: list[str], decimal: str | None, thousands: str) -> None:
    found = notation_of([cells])
    assert (found and found.decimal, found.thousands if found else "") == (decimal, thousands)


def test_as_many_files_as_were_promised() -> None:
    assert len(CASES) >= 30


def test_the_page_has_every_file_with_what_becomes_of_it() -> None:
    page = (Path(__file__).parents[2] / "docs" / "howto" / "exports.md").read_text("utf-8")
    assert [line for line in page.splitlines() if line.startswith("| ")][1:] == [
        f"| {case.shape} | {outcome(case)} |" for case in CASES
    ]
