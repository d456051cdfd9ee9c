"""Cells and data sets with a custom robot file: an arm of the library under another name."""

from __future__ import annotations

import tomllib
from pathlib import Path

import tomli_w

from calib.arm.robot import BUILT_IN
from tests.end_to_end.simulated import ROOT
from tests.service.campaigns import edit_text

NAME = "die-grüne-6"


def own_cell(folder: Path, example: str, robot: str) -> Path:
    """Write the cell of an example, with its robot as a file in the same folder."""
    folder.mkdir(parents=True, exist_ok=True)
    text = (BUILT_IN / f"{robot}.toml").read_text("utf-8")
    (folder / "own.toml").write_text(text.replace(f'name = "{robot}"', f'name = "{NAME}"'), "utf-8")
    cell = folder / "cell.toml"
    cell.write_text((ROOT / "examples" / example / "cell.toml").read_text("utf-8"), "utf-8")
    edit_text(cell, f'model = "{robot}"', 'model = "own.toml"')
    return cell


def with_own_robot(data: Path, cell: Path) -> Path:
    """A data set of that robot, its header as a campaign of the cell writes it; returns the CSV."""
    header = data.with_suffix(".toml")
    file = tomllib.loads(cell.with_name("own.toml").read_text("utf-8"))
    table = tomllib.loads(header.read_text("utf-8")) | {"robot": NAME, "robot_file": file}
    header.write_text(tomli_w.dumps(table), "utf-8")
    return data
