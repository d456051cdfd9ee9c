"""Files of another program read by the map that `truepose convert` keeps.

These would catch: a Python reader with other numbers than the command writes, one that accepts input that the command
refuses, and a robot file that is sought in another folder than the map's.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import truepose
from calib.errors import DataError
from service.cli import main
from tests.calib.exports import CASES, ROBOT
from tests.end_to_end.simulated import ROOT


def converted(name: str, folder: Path, robot: str = ROBOT) -> tuple[list[Path], Path]:
    """Files of a case and the map that was kept when they were converted to out.csv."""
    files = list(next(case for case in CASES if case.name == name).write(folder))
    answers = ["--answer", "match=order"] if name == "by_order" else []
    command = ["convert", *map(str, files), "--robot", robot, *answers, "--out", str(folder / "out.csv")]
    assert main([*command, "--sigma", "0.1"]) == 0
    return files, folder / "out.map.toml"


@pytest.mark.parametrize("name", ["excel_german", "by_order"])
def test_it_is_the_data_set_that_converting_writes(name: str, tmp_path: Path) -> None:
    files, map_file = converted(name, tmp_path)
    there = truepose.read(tmp_path / "out.csv")
    here = truepose.read(files if len(files) > 1 else files[0], map=map_file)
    assert here.readings.equals(there.readings)
    assert here.dataset.header.noise == there.dataset.header.noise
    assert truepose.identify(here).parameters.equals(truepose.identify(there).parameters)


def test_a_robot_file_is_looked_for_beside_the_map(tmp_path: Path) -> None:
    shutil.copyfile(ROOT / "calib" / "arm" / "robots" / f"{ROBOT}.toml", tmp_path / "mine.toml")
    files, map_file = converted("excel_german", tmp_path, str(tmp_path / "mine.toml"))
    assert 'robot = "mine.toml"' in map_file.read_text("utf-8")
    assert truepose.read(files[0], map=map_file).dataset.header.robot.joints == 6


def test_what_converting_refuses_is_refused(tmp_path: Path) -> None:
    files, map_file = converted("excel_german", tmp_path)
    other, wrong = tmp_path / "other.csv", tmp_path / "wrong.toml"
    other.write_text("a;b;c\n" + "1;2;3\n" * 9, "utf-8")
    wrong.write_text(map_file.read_text("utf-8").replace(ROBOT, "ur10"), "utf-8")
    with pytest.raises(DataError, match=r"as they are mapped .*abb-irb120"):
        truepose.read(files[0], map=wrong)
    with pytest.raises(DataError, match=r"out\.map\.toml"):
        truepose.read(other, map=map_file)
    with pytest.raises(DataError, match="is for 1 files, and 2 are given"):
        truepose.read([files[0], other], map=map_file)
    with pytest.raises(DataError, match="contains the header"):
        truepose.read(files[0], {"robot": ROBOT}, map=map_file)
    with pytest.raises(DataError, match="several files need a map"):
        truepose.read([files[0], other])
    with pytest.raises(DataError, match="can be used with names of files only"):
        truepose.read(truepose.read(tmp_path / "out.csv").readings, map=map_file)
