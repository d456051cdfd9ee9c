"""`truepose robot`.

These would catch: a file that is written over, a question that stops a script, and an answer taken as a number that is
none. They would also catch a mistake reported with exit code 0, and a picture that is no picture.
"""

from __future__ import annotations

import io
import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from calib.arm.kinematics import forward
from calib.arm.robot import built_in_robots, load_robot
from service import exit_codes
from service.cli import main
from tests.calib.test_robot_check import GOOD, HEADER, readings
from tests.calib.test_urdf_import import six, urdf

LINKS = ["-90 0 0 290 -165 165", "0 270 -90 0 -110 110", "slides 0 0 0 0 0 300"]


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_file_is_written_from_options_alone() -> None:
    links = [word for link in LINKS for word in ("--link", link)]
    options = ["--name", 'my "arm"', "--maker", "Me", "--convention", "dh", "--source", "a drawing"]
    assert main(["robot", "new", "arm.toml", *options, *links]) == exit_codes.DONE
    robot = load_robot("arm.toml")
    assert (robot.name, robot.kinds, robot.d[0]) == ('my "arm"', ("turns", "turns", "slides"), 290.0)
    before = Path("arm.toml").read_text("utf-8")
    assert main(["robot", "new", "arm.toml", *options, *links]) == exit_codes.USAGE
    assert Path("arm.toml").read_text("utf-8") == before


def test_what_no_option_gives_is_asked_until_it_is_an_answer(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answers = [
        "arm",
        "Me",
        "craig",
        "mdh",
        "none",
        "2",
        "0 0 0",
        LINKS[0],
        "0 1 0 1 9 -9",
        LINKS[1],
        "drawing",
    ]
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(answers) + "\n"))
    assert main(["robot", "new", "arm.toml"]) == exit_codes.DONE
    assert load_robot("arm.toml").joints == 2
    asked = capsys.readouterr()
    assert not asked.out.strip()  # questions stand on standard error
    assert "is not a row of six numbers" in asked.err
    assert "limits swapped: 9 to -9" in asked.err


def test_nobody_answers(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("arm\n"))
    assert main(["robot", "new", "arm.toml"]) == exit_codes.USAGE
    assert "the input has ended. Give --name, --maker" in capsys.readouterr().err
    assert not Path("arm.toml").exists()


def test_a_urdf_becomes_a_file_that_check_draws(capsys: pytest.CaptureFixture[str]) -> None:
    Path("in.urdf").write_text(urdf(*six()), "utf-8")
    assert main(["robot", "import", "in.urdf", "-o", "arm.toml", "--name", "mine"]) == exit_codes.DONE
    assert "200 random postures" in capsys.readouterr().err
    home = "0,-20,30,0,45,0"
    shown = ["--home", home, "--picture", "arm.svg", "--json", "-"]
    assert main(["robot", "check", "arm.toml", *shown]) == exit_codes.DONE
    found = json.loads(capsys.readouterr().out)
    robot = load_robot("arm.toml")
    posture = {each["name"]: each for each in found["postures"]}["home"]
    flange = forward(robot, np.radians([[float(x) for x in home.split(",")]]))[0]
    np.testing.assert_allclose(posture["flange_mm"], flange[:3, 3])
    assert found["wrist"].startswith("spherical")
    picture = ET.parse("arm.svg").getroot()
    numbers = {text.text for text in picture.iter("{http://www.w3.org/2000/svg}text")}
    assert {"1", "6", "oblique", "from above", "mine, home"} <= numbers


def test_a_table_needs_its_convention(capsys: pytest.CaptureFixture[str]) -> None:
    Path("in.csv").write_text("alpha;a;theta;d\n-90;0;0;290\n0;270;-90;0\n", "utf-8")
    assert main(["robot", "import", "in.csv"]) == exit_codes.USAGE
    assert "--convention dh" in capsys.readouterr().err
    assert main(["robot", "import", "in.csv", "--convention", "mdh", "--tip", "x"]) == exit_codes.USAGE
    assert main(["robot", "import", "in.csv", "--convention", "mdh"]) == exit_codes.DONE
    assert load_robot("in.toml").convention == "mdh"


def test_readings_that_show_a_mistake_end_with_exit_code_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = readings(tmp_path, HEADER)
    Path("own.toml").write_text(GOOD, "utf-8")
    assert main(["robot", "check", "own.toml", str(data)]) == exit_codes.DONE
    Path("bad.toml").write_text(GOOD.replace("a_mm = -612.0", "a_mm = 612.0"), "utf-8")
    capsys.readouterr()
    assert main(["robot", "check", "bad.toml", str(data), "--json", "-"]) == exit_codes.NOT_MET
    found = json.loads(capsys.readouterr().out)["readings"]
    assert not found["explained"]
    assert found["mistakes"][0]["lines"][0].startswith("bad.toml, line 18: a_mm = -612.0")


@pytest.mark.parametrize(
    "arguments",
    [
        ["check", "ur5", "--home", "1,2,3"],
        ["check", "ur5", "--home", "a,b,c,d,e,f"],
        ["check", "ur5", "--picture", "x.svg", "--posture", "home"],
        ["check", "nobody"],
        ["new", "arm.txt"],
        ["import", "none.urdf"],
    ],
)
def test_what_cannot_be_meant_is_refused(arguments: list[str]) -> None:
    assert main(["robot", *arguments]) == exit_codes.USAGE


def test_the_library_is_listed_and_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot", "list"]) == exit_codes.DONE
    listed = capsys.readouterr().out
    assert all(name in listed for name in built_in_robots())
    assert main(["robot", "show", "ur5", "--json", "-"]) == exit_codes.DONE
    assert json.loads(capsys.readouterr().out)["links"][1]["a_mm"] == -425.0
    assert main(["robot", "schema"]) == exit_codes.DONE
    assert json.loads(capsys.readouterr().out)["title"] == "truepose-robot/1"
