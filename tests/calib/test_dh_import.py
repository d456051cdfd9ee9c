"""Robot files from DH tables as people export them.

The tests catch a column taken for another, a unit that is guessed without a statement or without evidence, and a cell
that is not a number but is read as one.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.arm import forward
from calib.arm.robot import Convention
from calib.errors import DataError
from calib.robot_file import import_dh
from calib.robot_file.dh_words import cell, heading

SAME = {
    "plain": "link,alpha_deg,a_mm,theta_deg,d_mm,min_deg,max_deg\n1,-90,0,0,290,-165,165\n2,0,270,-90,0,-110,110\n",
    "semicolons, decimal commas, another order": (
        "Joint;d (mm);θ (°);a (mm);α (°);min;max\n1;290,0;0;0;-90,0;-165;165\n2;0;-90;270,0;0;-110;110\n"
    ),
    "multiples of pi, metres": (
        "i\ttheta_i\td_i [m]\ta_i [m]\talpha_i\tlower\tupper\n"
        f"1\tq1\t0.29\t0\t-pi/2\t{math.radians(-165)}\t{math.radians(165)}\n"
        f"2\tq2 - π/2\t0\t0.27\t0\t{math.radians(-110)}\t{math.radians(110)}\n"
    ),
    "radians by their values": (
        "alpha,a,theta,d,min (deg),max (deg)\n-1.5708,0,0,0.29,-165,165\n0,0.27,-1.5708,0,-110,110\n"
    ),
    "a title and empty lines above": (
        "My arm\n\nlink;Twist (deg);Link length (mm);Offset (deg);d (mm);qmin (deg);qmax (deg)\n"
        "1;−90;0;0;290;−165;165\n\n2;0;270;−90;0;−110;110\n"
    ),
}


@pytest.mark.parametrize("how", SAME)
def test_the_same_table_in_other_words_is_the_same_arm(how: str, tmp_path: Path) -> None:
    (tmp_path / "arm.csv").write_text(SAME[how], "utf-8")
    _, robot, remarks = import_dh(tmp_path / "arm.csv", "dh")
    np.testing.assert_allclose(np.degrees(robot.alpha), [-90, 0], atol=1e-9)
    np.testing.assert_allclose(np.degrees(robot.theta), [0, -90], atol=1e-9)
    np.testing.assert_allclose(np.degrees(robot.lower), [-165, -110], atol=1e-4)
    np.testing.assert_allclose([*robot.a, *robot.d], [0, 270, 290, 0], atol=1e-9)
    assert "Angles were read as" in remarks[0]


def imported(folder: Path, text: str, convention: Convention | None = "dh", **more: Any) -> Any:
    (folder / "arm.csv").write_text(text, "utf-8")
    return import_dh(folder / "arm.csv", convention, **more)


@pytest.mark.parametrize(
    ("alpha", "deg", "unit"),
    [
        ("1.57", 90, "rad"),
        ("-1.5708", -90, "rad"),
        ("1,5707", 90, "rad"),
        ("0.785", 45, "rad"),
        ("3.1416", 180, "rad"),
        ("q1 - 1.57", -90, "rad"),
        ("1.62", None, "rad"),
        ("89.9544", 90, "deg"),
        ("-90.0002", -90, "deg"),
        ("89.5", 89.5, "deg"),
        ("1.57", 1.57, "deg"),
        ("90.01", 90.01, "deg"),
    ],
)
def test_quarter_turns_are_meant_as_such_and_said(
    alpha: str, deg: float | None, unit: Any, tmp_path: Path
) -> None:
    text = f"alpha;a;theta;d\n{alpha};0;0;290\n0;270;0;0\n"
    draft, robot, remarks = imported(tmp_path, text, angles=unit)
    wanted = math.degrees(1.62) if deg is None else deg
    assert np.degrees(robot.alpha[0]) == pytest.approx(wanted, abs=1e-9)
    assert draft.links[0].alpha_deg == pytest.approx(wanted, abs=1e-12)
    snapped = deg is not None and deg % 45.0 == 0.0
    assert any(f"taken as {abs(deg or 0):g} deg exactly" in remark for remark in remarks) == snapped


def test_a_joint_that_counts_the_other_way_is_in_a_joint_matrix(tmp_path: Path) -> None:
    plain = imported(tmp_path, "alpha,a,theta,d\n-90,0,0,290\n0,270,-90,0\n")[1]
    text = "alpha,a,theta,d,Direction\n-90,0,0,290,-1\n0,270,-90,0,+1\n"
    _, robot, remarks = imported(tmp_path, text)
    counted = np.array([[0.3, 0.4], [-1.0, 0.2]])
    np.testing.assert_allclose(
        forward(robot, robot.model_angles(counted, "direction")), forward(plain, counted * [-1.0, 1.0])
    )
    assert any('joint_coupling = "direction"' in remark for remark in remarks)
    both = imported(tmp_path, text.replace("-1\n", "1\n"))
    assert both[1].joint_matrices == {}
    with pytest.raises(DataError, match=r"line 2: the direction is 'cw'\. Write 1 or -1"):
        imported(tmp_path, text.replace(",-1\n", ",cw\n"))


@pytest.mark.parametrize(
    "cell",
    [
        "-165..165",
        "-165 to 165",
        "±165",
        "+/-165°",
        "[-165; 165]",
        "+165/-165",
        "-165 - 165",
        "-2.87979..2.87979",
    ],
)
def test_limits_in_a_range_column(cell: str, tmp_path: Path) -> None:
    unit = "rad" if "2.8" in cell else "deg"
    text = f"alpha_deg\ta\ttheta\td\tRange [{unit}]\n-90\t0\t0\t290\t{cell}\n0\t270\t-90\t0\t{cell}\n"
    _, robot, remarks = imported(tmp_path, text)
    np.testing.assert_allclose(np.degrees([robot.lower, robot.upper]), [[-165] * 2, [165] * 2], atol=1e-3)
    assert not any("left aside" in remark or "no limits" in remark for remark in remarks)
    for wrong in ("330", "wide", "", "pi/2"):
        with pytest.raises(DataError, match="line 2: the range is"):
            imported(tmp_path, text.replace(cell, wrong))


LIMITED = "alpha_deg,a,theta,d,min{0},max{0}\n-90,0,0,290,{1},{2}\n0,270,-90,0,{1},{2}\n"


def test_limits_in_radians_are_not_read_as_degrees(tmp_path: Path) -> None:
    for unit, low, high in (("", -2.88, 2.88), ("_deg", -2.88, 2.88), ("_rad", -165, 165)):
        with pytest.raises(DataError, match="--limits"):
            imported(tmp_path, LIMITED.format(unit, low, high))
    for unit, asked in (("_rad", None), ("", "rad"), ("_deg", "rad")):
        robot = imported(tmp_path, LIMITED.format(unit, -2.88, 2.88), limits=asked)[1]
        assert robot.upper == pytest.approx([2.88, 2.88], abs=1e-5)
    narrow = imported(tmp_path, LIMITED.format("", -2.88, 2.88), limits="deg")[1]
    assert np.degrees(narrow.upper) == pytest.approx([2.88, 2.88])
    pi = imported(
        tmp_path, LIMITED.format("", "-pi/2", "pi/2").replace("alpha_deg", "alpha").replace("90", "pi/2")
    )
    assert pi[1].upper == pytest.approx([math.pi / 2] * 2, abs=1e-5)
    other = imported(
        tmp_path, LIMITED.format("", -165, 165).replace("alpha_deg", "alpha").replace("90", "pi/2")
    )
    assert np.degrees(other[1].upper) == pytest.approx([165, 165])
    with pytest.raises(DataError, match="both limits at 0"):
        imported(tmp_path, LIMITED.format("", "", ""))


def test_an_arm_of_no_size_that_arms_have_is_asked_about(tmp_path: Path) -> None:
    for text, unit, reach in (
        ("alpha,a,theta,d\n-90,0,0,29000\n0,11000,-90,0\n", "mm", 29000.0),
        ("alpha,a_mm,theta,d_mm\n-90,0,0,0.29\n0,0.27,-90,0\n", "m", 290.0),
        ("alpha,a_m,theta,d_m\n-90,0,0,290\n0,270,-90,0\n", "mm", 290.0),
    ):
        with pytest.raises(DataError, match=r"line 2: .* --lengths"):
            imported(tmp_path, text)
        assert imported(tmp_path, text, lengths=unit)[1].d[0] == pytest.approx(reach)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("alpha_{i-1},a_{i-1},theta_i,d_i\n0,0,0,290\n-90,270,0,0\n", "mdh"),
        ("αi−1 (°);ai−1 (mm);θi;di\n0;0;0;290\n-90;270;0;0\n", "mdh"),
        ("alpha(i-1),a(i-1),theta(i),d(i)\n0,0,0,290\n-90,270,0,0\n", "mdh"),
        ("Modified DH parameters\nalpha,a,theta,d\n0,0,0,290\n-90,270,0,0\n", "mdh"),
        ("alpha,a,theta,d,convention\n0,0,0,290,mdh\n-90,270,0,0,mdh\n", "mdh"),
        ("Classical Denavit-Hartenberg\nalpha,a,theta,d\n0,0,0,290\n-90,270,0,0\n", "dh"),
    ],
)
def test_the_convention_that_a_table_shows_is_believed(text: str, shown: Any, tmp_path: Path) -> None:
    assert imported(tmp_path, text, None)[1].convention == shown
    assert imported(tmp_path, text, shown)[1].convention == shown
    with pytest.raises(DataError, match=f"--convention {shown}"):
        imported(tmp_path, text, "dh" if shown == "mdh" else "mdh")


def test_a_table_without_a_convention_asks_for_it(tmp_path: Path) -> None:
    for words in ("", "Robot modified 2024-05-01\n"):
        with pytest.raises(DataError, match="--convention dh"):
            imported(tmp_path, f"{words}alpha,a,theta,d\n0,0,0,290\n-90,270,0,0\n", None)


def test_what_is_not_read_is_listed_or_refused(tmp_path: Path) -> None:
    text = "link,alpha,a,theta,d,mass_kg,,beta\nx,-90,0,0,290,4,,0\ny,0,270,-90,0,3,?,0\n"
    aside = [remark for remark in imported(tmp_path, text)[2] if "left aside" in remark]
    assert [remark.split("'")[1] for remark in aside] == ["mass_kg", "number 7"]
    with pytest.raises(DataError, match=r"line 2: has a beta"):
        imported(tmp_path, text.replace("4,,0", "4,,0.1"))
    with pytest.raises(DataError, match="line 4: holds no numbers"):
        imported(tmp_path, text + "from the data sheet,,,,,,,\n")


def test_empty_cells_and_the_convention_that_was_read_are_said(tmp_path: Path) -> None:
    remarks = imported(tmp_path, "alpha,a_{i-1},theta,d\n0,0,0,290\n,270,-90,0\n", None)[2]
    assert any("alpha = 0 (lines 3)" in remark for remark in remarks)
    assert any("read as mdh: 'a_{i-1}' shows it" in remark for remark in remarks)
    plain = imported(tmp_path, "alpha;a;theta;d\n90;0,5;0;1,290\n0;270;0;0\n", lengths="mm")[1]
    assert plain.d[0] == 1.29, "where a comma is a decimal one, it is one everywhere"


def test_a_slide_is_known_by_its_word_or_by_its_variable(tmp_path: Path) -> None:
    for text in (
        "type;alpha deg;a mm;theta;d mm;min;max\nR;0;325;0;0;-130;130\nP;180;275;0;0;0;200\n",
        "alpha deg;a mm;theta;d mm;min;max\n0;325;q1;0;-130;130\n180;275;0;d2;0;200\n",
    ):
        (tmp_path / "arm.csv").write_text(text, "utf-8")
        robot = import_dh(tmp_path / "arm.csv", "dh")[1]
        assert robot.kinds == ("turns", "slides")
        assert (robot.lower[1], robot.upper[1]) == (0.0, 200.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("alpha,a,theta,d\n0.3,0,0.2,290\n", "--angles deg or --angles rad"),
        ("alpha,a,theta,d\n90,0,0,12\n", "--lengths mm or --lengths m"),
        ("alpha_deg,a,theta_rad,d\n90,0,0,290\n", "names deg and rad"),
        ("alpha_deg,a,theta,d\npi/2,0,0,290\n", "says degrees, but holds pi"),
        ("alpha,alpha_i,a,theta,d\n90,90,0,0,290\n", "2 columns that mean alpha"),
        ("alpha,a,theta,d,min,max\n90,0,0,290,165,-165\n", "line 2: has its limits swapped"),
        ("alpha,a,theta,d,min\n90,0,0,290,165\n", "one limit without the other"),
        ("alpha,a,theta,d\n90,0,-q1,290\n", "line 2: theta is '-q1'"),
        ("alpha,a,theta,d\n90,0,abc,290\n", "theta is 'abc'"),
        ("x,y\n1,2\n", "no row of headings"),
        ("", "no row of headings"),
        ("alpha,a,theta,d\n", "0 rows"),
        ("alpha,a,theta,d,type\n90,0,0,290,ball\n", "the joint is 'ball'"),
        ("link,alpha,a,theta,d\n1,90,0,0,290\n3,0,270,0,0\n2,90,0,0,70\n", "line 3: row 3 follows row 1"),
        ("link,alpha,a,theta,d\nJ2,90,0,0,290\nJ1,0,270,0,0\n", "line 3: row 1 follows row 2"),
        ("link,alpha,a,theta,d\n1,90,0,0,290\ntool,0,0,0,120\n", "line 3: is the row of 'tool'"),
        ("alpha;a;theta;d\n90;0;0;1,290\n0;270;0;0\n", "line 2: '1,290' may be 1290 or 1.290"),
        ("alpha;a;theta;d\n90;0;0;1,290\n0;70.5;0;0\n", "line 2: '1,290' may be 1290 or 1.290"),
        ("alpha_deg,a,theta_deg,d\n1.5708,0,0,290\n", "largest is 1.5708. If they are rad, say --angles rad"),
        ("alpha [rad],a,theta [rad],d\n90,0,0,290\n", "largest is 90. If they are deg, say --angles deg"),
    ],
)
def test_what_a_table_does_not_say_is_asked_for(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "arm.csv").write_text(text, "utf-8")
    with pytest.raises(DataError, match=words):
        import_dh(tmp_path / "arm.csv", "dh")


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("90", 90),
        ("- 90", -90),
        ("-pi/2", -math.pi / 2),
        ("3*pi/4", 0.75 * math.pi),
        ("2π", 2 * math.pi),
        ("12,5", 12.5),
    ],
)
def test_cells(word: str, value: float) -> None:
    found = cell(word)
    assert found is not None
    assert found.value == pytest.approx(value)
    assert not found.variable


@pytest.mark.parametrize(
    ("word", "meaning", "unit"),
    [
        ("alpha_{i-1} [deg]", "alpha", "deg"),
        ("αi-1 (°)", "alpha", "deg"),
        ("a (mm)", "a", "mm"),
        ("d_i", "d", ""),
    ],
)
def test_headings(word: str, meaning: str, unit: str) -> None:
    assert (heading(word).meaning, heading(word).unit) == (meaning, unit)
