"""Robot files out of DH tables as people export them. These would catch: a column taken for another, a unit guessed
without being said or guessed where nothing shows it, and a cell that is no number read as one."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

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
    np.testing.assert_allclose(np.degrees(robot.alpha), [-90, 0], atol=3e-4)
    np.testing.assert_allclose(np.degrees(robot.theta), [0, -90], atol=3e-4)
    np.testing.assert_allclose(np.degrees(robot.lower), [-165, -110], atol=1e-4)
    np.testing.assert_allclose([*robot.a, *robot.d], [0, 270, 290, 0], atol=1e-9)
    assert "Angles were read as" in remarks[0]


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
