"""Keys, columns and defaults in `docs/files.md`.

The program must read exactly these.

Files are read through tables that note the requested keys. These would catch a key that a reader learns and the page
does not have, a default that changes, and a key that no code reads any more.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from acquisition.cell.cell import SimulationSection
from calib import identify, load_robot, read_dataset, save_model
from calib.arm.robot import BUILT_IN
from calib.data import read_header
from calib.foreign import read_map
from calib.foreign.map import map_file
from calib.foreign.map.map_file import is_quantity
from calib.robot_file import SCHEMA
from calib.text import TextTable
from mocks.cell_file import CellFile
from tests.calib.machines import machine
from tests.service.campaigns import write_data

ROOT = Path(__file__).parents[2]
FREE = {  # tables whose keys are names that people give
    *("tool_targets", "base_targets", "priors", "series", "joint_matrices", "targets", "columns", "header"),
    *("tool_targets_u_mm", "base_targets_u_mm"),
}
# What no example has
HEADER = """
format = "truepose-dataset/1"
robot = "ur5"
[[loads]]
link = 6
mass_kg = 1.0
cog_mm = [0.0, 0.0, 50.0]
[model]
level = 2
[noise]
kind = "isotropic"
sigma_mm = 0.1
[measured]
began = "a"
ended = "b"
"""
Asked = dict[str, set[Any]]
"""Key -> defaults that it was asked with."""


class Noting(dict[str, Any]):
    """Table that notes the requested keys and their defaults, as do the tables in it."""

    def __init__(self, values: Mapping[str, Any], asked: Asked, *, free: bool = False) -> None:
        super().__init__({key: _noting(value, asked, key) for key, value in values.items()})
        self.asked, self.free = asked, free

    def note(self, key: str, default: Any = None) -> None:
        if not self.free:
            plain = isinstance(default, str | int | float)
            self.asked.setdefault(key, set()).update([default] if plain else [])

    def get(self, key: str, default: Any = None) -> Any:
        self.note(key, default)
        return super().get(key, default)

    def __getitem__(self, key: str) -> Any:
        self.note(key)
        return super().__getitem__(key)


def _noting(value: Any, asked: Asked, key: str) -> Any:
    if isinstance(value, dict):
        return Noting(value, asked, free=key in FREE)
    return [_noting(each, asked, key) for each in value] if isinstance(value, list) else value


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Asked]:
    """Return the requested keys of files of each format."""
    found: dict[str, Asked] = {}
    loads = tomllib.loads

    def noted(text: str) -> Noting:
        table = loads(text)
        return Noting(table, found.setdefault(table["format"], {}))

    monkeypatch.setattr(tomllib, "loads", noted)
    return found


def documented(title: str) -> dict[str, str]:
    """Return the default's cell by key, from the tables in a section of docs/files.md."""
    text = (ROOT / "docs" / "files.md").read_text("utf-8")
    section = text.split(f"\n## {title}\n")[1].split("\n## ")[0]
    found: dict[str, str] = {}
    for line in section.splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if line.startswith("| `"):
            for key in re.findall(r"`([^`]+)`", cells[1]):
                found[key] = f"{found.get(key, '')} {cells[3]}"
    return found


def hold(title: str, asked: Asked) -> None:
    """Assert that the section names exactly the requested keys, with their defaults."""
    page = documented(title)
    assert set(page) == set(asked)
    wrong = {key: each for key, defaults in asked.items() for each in defaults if not _said(each, page[key])}
    assert not wrong


def _said(default: Any, cell: str) -> bool:
    if isinstance(default, bool):
        return not default or "true" in cell
    if isinstance(default, str):
        return default in cell
    numbers = [float(each) for each in re.findall(r"-?\d+\.?\d*", cell)]
    return float(default) in numbers


def test_data_sets(asked: dict[str, Asked], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    columns: Asked = {}

    def note(method: str) -> None:
        before = getattr(TextTable, method)

        def after(self: TextTable, column: str, *others: Any, **named: Any) -> Any:
            key = re.sub(r"^(j|approach|prev)\d+", r"\1K", column)
            columns.setdefault(key, set()).update(others if method == "text" else ())
            return before(self, column, *others, **named)

        monkeypatch.setattr(TextTable, method, after)

    for method in ("text", "numbers", "require"):
        note(method)
    for name in (
        "irb120_mixed",
        "irb120_ballbar",
        "irb120_free_bases",
        "irb120_two_nights",
        "lrmate_coupled",
    ):
        read_dataset(ROOT / "tests" / "certified" / f"{name}.csv")
    (tmp_path / "more.toml").write_text(HEADER, "utf-8")
    read_header(tmp_path / "more.toml")
    hold("Data set: NAME.toml", asked["truepose-dataset/1"])
    hold("Data set: NAME.csv", columns)


def test_maps(asked: dict[str, Asked], tmp_path: Path) -> None:
    columns = "".join(f'{axis} = "{axis}[mm]"\n' for axis in "xyz")
    text = f"[[file]]\n[file.columns]\n{columns}[file.targets.T1]\n{columns}[header.holdout]\n"
    (tmp_path / "map.toml").write_text(f'format = "truepose-map/1"\n{text}[match]\nby = "name"\n', "utf-8")
    read_map(tmp_path / "map.toml")
    read = asked["truepose-map/1"]
    axes = {axis: read.pop(axis) for axis in "xyz"}
    quantities = {key for key in documented("Map: MAP.toml") if key not in read}
    assert all(is_quantity(key) for key in quantities)
    assert quantities >= {*axes, *map_file._TEXT, *map_file._NUMBER}
    page = {key: cell for key, cell in documented("Map: MAP.toml").items() if key in read}
    assert set(page) == set(read)
    assert not {key: each for key, of in read.items() for each in of if not _said(each, page[key])}


def test_robots(asked: dict[str, Asked], tmp_path: Path) -> None:
    """The schema has the requested keys; the page has an example of each, see below."""
    machine("track", tmp_path)
    for path in BUILT_IN.glob("*.toml"):
        load_robot(path.stem)
    assert set(asked["truepose-robot/1"]) == robot_keys()


def test_a_simulator_has_the_defaults_of_the_cell_file() -> None:
    """The simulators have a reader of their own."""
    simulated = {field.name: field.default for field in fields(CellFile)}
    given = {key: field.default for key, field in SimulationSection.model_fields.items() if key in simulated}
    assert len(given) >= 9
    assert {key: simulated[key] for key in given if key != "misplaced_mm"} == {
        key: default for key, default in given.items() if key != "misplaced_mm"
    }


def test_models(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    save_model(path, identify(read_dataset(write_data(tmp_path))))
    document = json.loads(path.read_text("utf-8"))
    assert set(documented("Model: MODEL.json")) == {
        *document,
        *document["parameters"][0],
        "regression",
        "updates",
    }


def test_every_key_of_a_robot_file_has_an_example(tmp_path: Path) -> None:
    """The pieces of the page form a readable file together, and have every key."""
    text = (ROOT / "docs" / "robot-file.md").read_text("utf-8")
    pieces = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (tmp_path / "whole.toml").write_text("\n".join(pieces), "utf-8")
    robot = load_robot("whole.toml", tmp_path)
    assert (robot.kinds[0], robot.joint_columns[0]) == ("slides", "e1_mm")
    assert {key for key in robot_keys() if not re.search(rf"\b{key}\b", "\n".join(pieces))} == set()


def robot_keys() -> set[str]:
    """Return all keys of the schema of robot files, of nested tables too."""
    properties = SCHEMA["properties"]
    tables = [properties["link"], properties["loads"], properties["capsule"]]
    inner = [each["items"]["properties"] for each in tables]
    inner.append(properties["joint_matrices"]["additionalProperties"]["properties"])
    return {*properties, *(key for each in inner for key in each)}
