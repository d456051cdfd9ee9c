"""A cell with a custom robot file: the data of it that a record and a data set carry.

They must work without the file. These would catch: a record that cannot be continued on another computer, a data set
whose robot is unknown, and a file that passes for a robot of the library.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tomli_w

from acquisition import campaign_from, read_cell
from acquisition.campaign import make_plan
from acquisition.cell import cell_from, cell_of_record
from acquisition.record import planned_header
from calib import DataError, load_robot
from calib.data import header_of
from calib.text import read_toml
from drivers import ConfigError
from tests.acquisition.fakes import CAMPAIGN, CELL, changed
from tests.calib.machines import SCARA, TRACK

BY_HAND = {"robot__driver": "manual", "robot__limits_deg": None, "robot__url": None}


def written(folder: Path, robot: str, **values: object) -> Path:
    """Write a cell file, with its robot file in a subfolder."""
    (folder / "robots").mkdir()
    (folder / "robots" / "own.toml").write_text(robot, encoding="utf-8")
    path = folder / "cell.toml"
    table = changed(CELL, **{**BY_HAND, "robot__model": "robots/own.toml", **values})
    path.write_text("# of mine\n" + tomli_w.dumps(table), encoding="utf-8")
    return path


def test_a_record_carries_the_robot_file(tmp_path: Path) -> None:
    cell = read_cell(written(tmp_path, TRACK))
    assert cell.source.startswith("# of mine\n")
    elsewhere = cell_of_record(cell.source, str(tmp_path / "records" / "record.sqlite3"))
    assert elsewhere.robot.model == cell.robot.model
    assert elsewhere.source == cell.source
    assert cell_from(changed(CELL), "cell.toml").robot.file is None


def test_a_table_in_one_line_carries_it_too(tmp_path: Path) -> None:
    path = written(tmp_path, SCARA)
    _, table = read_toml(path)
    inline = ", ".join(
        f'{key} = "{value}"' for key, value in table["robot"].items() if isinstance(value, str)
    )
    rest = tomli_w.dumps({key: value for key, value in table.items() if key != "robot"})
    first, *tables = rest.split("\n[", 1)
    path.write_text(f"{first}\nrobot = {{ {inline} }}\n[{tables[0]}", encoding="utf-8")
    cell = read_cell(path)
    assert cell_of_record(cell.source, "elsewhere").robot.model == cell.robot.model


def test_a_data_set_carries_the_robot_file(tmp_path: Path) -> None:
    cell = read_cell(written(tmp_path, TRACK))
    header = planned_header(cell)
    assert header["noise"]["repeatability_mm"] == cell.robot.repeatability_mm
    elsewhere = tmp_path / "elsewhere"
    assert header_of(header, elsewhere / "data.toml", "").robot == cell.robot.model
    with pytest.raises(DataError, match="is that of 'track'"):
        header_of(header | {"robot": "mine"}, elsewhere / "data.toml", "")
    of_library = load_robot("abb-irb120").name
    pretended = header["robot_file"] | {"name": of_library}
    with pytest.raises(DataError, match="the name of a robot of the library"):
        header_of(header | {"robot": of_library, "robot_file": pretended}, elsewhere / "data.toml", "")


def test_a_file_with_the_name_of_a_robot_of_the_library_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="the name of one of the library, 'ur5'"):
        read_cell(written(tmp_path, SCARA.replace('name = "scara"', 'name = "ur5"')))


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"unknown robot 'robots/other\.toml'"):
        read_cell(written(tmp_path, SCARA, robot__model="robots/other.toml"))


def test_joints_that_slide_are_counted_in_mm(tmp_path: Path) -> None:
    robot = read_cell(written(tmp_path, TRACK)).robot
    assert robot.limits_deg[0] == (0.0, 4000.0)
    counted = np.array([[1500.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]])
    np.testing.assert_allclose(robot.model_angles(counted)[0, :2], [1500.0, np.radians(10.0)])
    np.testing.assert_allclose(robot.counted(robot.model_angles(counted)), counted)
    assert robot.said(counted[0][:7]).startswith("e1 1500 mm, j1 10 deg, ")
    assert (robot.named(0), robot.named(1)) == ("axis e1", "joint 1")


def test_sweeps_are_of_joints_that_turn(tmp_path: Path) -> None:
    cell = read_cell(written(tmp_path, TRACK))
    block = {"kind": "sweep", "joint": 1, "range_deg": [0.0, 20.0], "step_deg": 5.0, "set": "calibration"}
    campaign = campaign_from(changed(CAMPAIGN) | {"block": [block]}, "campaign.toml")
    with pytest.raises(ConfigError, match=r"turns joint 1 \(e1\), which slides"):
        make_plan(cell, campaign)
