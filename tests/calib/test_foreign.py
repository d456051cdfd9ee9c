"""Test that exported measurements (`tests.calib.exports`) are read or refused correctly.

These would catch: a separator, decimal, encoding, unit, convention, target or pairing read wrongly, a question that
is guessed in place of asked, and a cell that is skipped in silence.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import DataError, forward
from calib.data import dataset_of, header_of
from calib.data.plausible import remarks
from calib.foreign import converted, data_set_of, propose, read_map, text_of
from calib.foreign.files.number import Notation, notation_of
from calib.foreign.map.map_file import Map, sequence_of
from calib.foreign.readings.matching import matched
from calib.foreign.readings.readings import ForeignReadings
from calib.text import TextTable, parse_toml
from calib.units import DEG
from tests.calib.exports import CASES, ROBOT, TRUTH, Case, N, outcome
from tests.calib.machines import machine


def converted_text(case: Case, folder: Path) -> tuple[str, str]:
    """Convert a case; the map is kept in a file between proposal and conversion.

    Raises
    ------
    DataError
        The case is refused.
    """
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
        TextTable.of_text(csv, tmp_path / "out.csv"),
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


@pytest.mark.parametrize(("answer", "off"), [("commanded", 0.0), ("read", 0.27)])
def test_joints_that_were_read_back_elsewhere(answer: str, off: float, tmp_path: Path) -> None:
    """Joints read elsewhere are used as answered, and their difference is reported.

    It is reported whenever the map is used, and by a fit.
    """
    files = case_of("read_elsewhere").write(tmp_path)
    (question,) = propose(files, {"robot": ROBOT}).questions
    assert (question.choices, question.proposed) == (("commanded", "read"), "commanded")
    assert "0.27 deg" in question.text
    made = propose(files, {"robot": ROBOT, "joints.read": answer}).made
    found = converted(made, files, "map.toml", tmp_path)
    data = data_set_of(found.table, found.fit, tmp_path / "out.csv", files)
    np.testing.assert_allclose(data.conditions.joints[1, 0] / DEG - TRUTH.joints[1, 0], off, atol=2e-5)
    assert data.header.read_back == (answer == "read")
    said = [line for line in found.said if "elsewhere than commanded: joint 1 by up to 0.270 deg" in line]
    assert bool(said) == (answer == "commanded")
    assert any("read" in line and "joint" in line for line in remarks(data))


def test_joints_that_were_read_back_alone(tmp_path: Path) -> None:
    files = case_of("only_read").write(tmp_path)
    for answer in ("read", "commanded"):
        made = propose(files, {"robot": ROBOT, "joints.read": answer}).made
        found = converted(made, files, "map.toml", tmp_path)
        data = data_set_of(found.table, found.fit, tmp_path / "out.csv", files)
        assert data.header.read_back == (answer == "read")
        assert any("not those commanded" in line for line in remarks(data)) == (answer == "read")


def test_columns_without_names_are_asked_about_with_a_proposal(tmp_path: Path) -> None:
    """Columns without names are asked about; their number gives the proposal.

    Without a robot nothing is decided.
    """
    files = case_of("nameless").write(tmp_path)
    questions = {question.key: question for question in propose(files, {}).questions}
    assert questions.keys() == {"columns", "robot"}
    assert questions["columns"].proposed == "j1..j6 x y z"
    assert "x y z j1..j6" in questions["columns"].choices
    assert propose(files, {"columns": "none"}).missing
    made = text_of(propose(files, {}).made)
    (tmp_path / "map.toml").write_text(made, "utf-8")
    with pytest.raises(DataError, match=r"undecided.*columns\.j1.*columns\.x"):
        converted(read_map(tmp_path / "map.toml"), files, "map.toml", tmp_path)
    files = case_of("groups").write(tmp_path)
    questions = {question.key: question for question in propose(files, {}).questions}
    assert questions.keys() == {"joints", "points", "robot"}
    assert (questions["joints"].proposed, questions["points"].proposed) == ("arm1", "probe1")
    wrong = propose(files, {"robot": ROBOT, "joints": "none"})
    assert any("joint angles" in each for each in wrong.missing)


def test_sixteen_numbers_that_are_no_pose_are_no_matrix(tmp_path: Path) -> None:
    names = [*(f"J{k} [deg]" for k in range(1, 7)), *(f"T{r}{c}" for r in range(1, 5) for c in range(1, 5))]
    rows = np.column_stack([TRUTH.joints, np.random.default_rng(1).normal(size=(N, 16))])
    np.savetxt(tmp_path / "a.csv", rows, "%.6f", ";", header=";".join(names), comments="")
    found = propose([tmp_path / "a.csv"], {"robot": ROBOT})
    assert any("measured coordinates" in each for each in found.missing)
    made = propose(case_of("matrix").write(tmp_path), {"robot": ROBOT}).made
    text = (tmp_path / "a.csv").read_text("utf-8").splitlines()
    spoilt = [";".join([*line.split(";")[:6], "9.0", *line.split(";")[7:]]) for line in text[2:3]]
    (tmp_path / "a.csv").write_text("\n".join([*text[:2], *spoilt, *text[3:]]), "utf-8")
    with pytest.raises(DataError, match=r"line 3.*not a rotation"):
        converted(made, [tmp_path / "a.csv"], "map.toml", tmp_path)


def test_a_wrong_convention_asks_for_nothing_else(tmp_path: Path) -> None:
    """The unit of the points follows from the robot, for any answer about the orientations."""
    turns = Rotation.from_quat(TRUTH.turns, scalar_first=True)
    rows = np.column_stack([TRUTH.joints, TRUTH.points[:, 0], turns.as_euler("ZYZ", degrees=True)])
    head = [*(f"J{k} [deg]" for k in range(1, 7)), "X", "Y", "Z", *(f"{a} [deg]" for a in ("rx", "ry", "rz"))]
    np.savetxt(tmp_path / "a.csv", rows, "%.6f", ";", header=";".join(head), comments="")
    files = [tmp_path / "a.csv"]
    (question,) = propose(files, {"robot": ROBOT}).questions
    assert question.key == "rotation"
    assert len({sequence_of(choice) for choice in question.choices}) == len(question.choices)
    wrong = propose(files, {"robot": ROBOT, "rotation": "staubli"})
    assert wrong.complete
    with pytest.raises(DataError, match="orientations that miss"):
        converted(wrong.made, files, "map.toml", tmp_path)
    right = propose(files, {"robot": ROBOT, "rotation": "intrinsic-ZYZ"})
    assert converted(right.made, files, "map.toml", tmp_path).fit is not None
    for answers in ({"rotation": "upwards"}, {"rotation": "staubli", "unit.points": "furlong"}):
        with pytest.raises(DataError, match="is not one of the answers"):
            propose(files, {"robot": ROBOT, **answers})


def test_a_point_at_the_origin_may_have_been_measured(tmp_path: Path) -> None:
    """The frame begins at the first point."""
    rows = np.column_stack([TRUTH.joints, TRUTH.points[:, 0] - TRUTH.points[0, 0]])
    head = [*(f"J{k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"]
    np.savetxt(tmp_path / "a.csv", rows, "%.6f", ";", header=";".join(head), comments="")
    files = [tmp_path / "a.csv"]
    (question,) = propose(files, {"robot": ROBOT}).questions
    assert (question.key, question.proposed) == ("origin", "measured")
    made = propose(files, {"robot": ROBOT, "origin": "measured"}).made
    found = converted(made, files, "map.toml", tmp_path)
    assert data_set_of(found.table, found.fit, tmp_path / "out.csv", files).usable.all()


@pytest.mark.parametrize(
    "names",
    [(1, 2, 3, 5), (1, 2, 3, 4), (1, 2, 3, 4, 5), (1, 2, 3, 0, 5)],
    ids=["gap", "numbered", "stands", "zero"],
)
def test_a_joint_that_follows_others_needs_no_column(names: tuple[int, ...], tmp_path: Path) -> None:
    """Joint 4 of a palletizer, held level by rods, needs no column.

    No motor drives it, and no controller counts it.
    """
    robot, rng = machine("palletizer", tmp_path), np.random.default_rng(5)
    counted = np.round(rng.uniform([-90, -30, 0, 0, -200], [90, 60, 70, 0, 200], (40, 5)), 3)
    model = robot.model_angles(counted * DEG, "rods")
    points = forward(robot, model)[:, :3] @ [80.0, 0.0, 200.0, 1.0] + rng.normal(0.0, 0.3, (40, 3))
    shown = {k: counted[:, k - 1] for k in (1, 2, 3, 5)} | {0: counted[:, 3], 4: model[:, 3] / DEG}
    if names == (1, 2, 3, 4):
        shown[4] = counted[:, 4]
    head = [*(f"J{k or 4} [deg]" for k in names), "X [mm]", "Y [mm]", "Z [mm]"]
    file = tmp_path / "a.csv"
    np.savetxt(
        file,
        np.column_stack([*(shown[k] for k in names), points]),
        "%.6f",
        ";",
        header=";".join(head),
        comments="",
    )
    proposal = propose([file], {"robot": str(tmp_path / "palletizer.toml")})
    assert proposal.complete
    found = converted(proposal.made, [file], "map.toml", tmp_path)
    data = data_set_of(found.table, found.fit, tmp_path / "out.csv", [file])
    assert data.header.coupling == "rods"
    np.testing.assert_allclose(data.conditions.joints, model, atol=1e-7)
    left_out = {name: cells for name, cells in found.table.columns.items() if name != "j4_deg"}
    again = data_set_of(replace(found.table, columns=left_out), found.fit, tmp_path / "out.csv", [file])
    np.testing.assert_allclose(again.conditions.joints, model, atol=1e-7)


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
        ('x = "X [mm][mm]"', 'x = "X [mm][m]"', r"span .* cannot be measured points"),
        ('x = "X [mm][mm]"', 'x = "X"', r"Write the name of the column and the unit"),
        ('x = "X [mm][mm]"', 'xx = "X [mm][mm]"', r"is not a quantity"),
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


def test_points_that_belong_to_other_rows_are_no_data_set(tmp_path: Path) -> None:
    """No robot fits them, and no other reading of the columns does."""
    kept = a_map(tmp_path)
    lines = (tmp_path / "a.csv").read_text("utf-8").splitlines()
    rows = [line.split(";") for line in lines[1:]]
    order = np.random.default_rng(1).permutation(len(rows))
    mixed = [";".join((*row[:6], *rows[i][6:])) for row, i in zip(rows, order, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join([lines[0], *mixed]) + "\n", "utf-8")
    found = converted(read_map(kept), [tmp_path / "a.csv"], kept, tmp_path)
    with pytest.raises(DataError, match=r"misses the nominal abb-irb120 .* no built-in robot"):
        data_set_of(found.table, found.fit, tmp_path / "o.csv", [tmp_path / "a.csv"])


def read_whole(kept: Path, folder: Path) -> None:
    """Map, file and data set of `a_map`."""
    table = converted(read_map(kept), [folder / "a.csv"], kept, folder).table
    header = header_of(parse_toml(table.header, "h"), folder / "o.toml", table.header)
    dataset_of(TextTable.of_text(table.text, folder / "o.csv"), header)


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
    page = (Path(__file__).parents[2] / "docs" / "evidence" / "exports.md").read_text("utf-8")
    assert [line for line in page.splitlines() if line.startswith("| ")][1:] == [
        f"| {case.shape} | {outcome(case)} |" for case in CASES
    ]


@pytest.mark.parametrize(
    ("cell", "value"), [("1,234.5", 1234.5), ("1,234,567", 1234567.0), ("1,23", None), ("12,34,567", None)]
)
def test_thousands_are_groups_of_three(cell: str, value: float | None) -> None:
    assert Notation(".", ",").number(cell) == value


@pytest.mark.parametrize("second", ["the same joints", "other joints"])
def test_a_name_that_means_two_poses_decides_nothing(second: str) -> None:
    file: Any = SimpleNamespace(sheet=SimpleNamespace(shown="poses.csv"))

    def named(names: tuple[str, ...], first: np.ndarray) -> ForeignReadings:
        n = len(names)
        joints = np.zeros((n, 6)) + first[:, None]
        nothing = ("",) * n
        axes = tuple(f"j{k}" for k in range(1, 7))
        texts = {"pose": names}
        return ForeignReadings(
            joints, axes, ("deg",) * 6, np.zeros((n, 3)), np.zeros((n, 4)), texts, {}, nothing
        )

    other = 0.1 if second == "the same joints" else 0.4
    poses = named(("P1", "P2", "P1"), np.array([0.1, 0.2, other]))
    points = named(("P1", "P2"), np.zeros(2))
    made = Map((), {}, by="name")
    if second == "the same joints":
        assert len(matched(poses, points, made, (file, file), "map.toml").points) == 2
    else:
        with pytest.raises(DataError, match=r"names 1 poses twice with other joints \(p1\)"):
            matched(poses, points, made, (file, file), "map.toml")


@pytest.mark.parametrize(
    ("name", "degrees", "read"),
    [
        ("Temp [C]", 21.5, True),
        ("T_air_c", 21.5, True),
        ("Temp [F]", 55.0, False),
        ("temp_f", 55.0, False),
        ("Temperature (°F)", 55.0, False),
        ("temperature", 295.0, False),
    ],
)
def test_only_temperatures_in_degc_are_taken_and_what_does_not_count_is_said(
    name: str, degrees: float, read: bool, tmp_path: Path
) -> None:
    heads = [*(f"J{k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]", name]
    rows = [[*joints, *point[0], degrees] for joints, point in zip(TRUTH.joints, TRUTH.points, strict=True)]
    rows[2][6:9] = ["", "", ""]
    file = tmp_path / "own.csv"
    file.write_text("\n".join(",".join(map(str, row)) for row in [heads, *rows]) + "\n", "utf-8")
    proposal = propose([file], {"robot": ROBOT})
    assert not proposal.questions
    assert ("t_air" in proposal.made.files[0].columns) == read
    said = converted(proposal.made, [file], "map", tmp_path).said
    assert any(f"1 of {len(rows)} readings have no point" in each for each in said)
