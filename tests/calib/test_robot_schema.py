"""Test that the JSON schema of robot files agrees with the reader, in keys and refusals."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calib.arm import joint_kinds, robot
from calib.arm.robot import BUILT_IN, built_in_robots, load_robot
from calib.errors import DataError
from calib.robot_file import SCHEMA

jsonschema = pytest.importorskip("jsonschema")
GOOD = tomllib.loads((BUILT_IN / "fanuc-lrmate200ic.toml").read_text("utf-8"))
SLIDES = {"joint": "slides", "axis": "e1", "alpha_deg": 0.0, "a_mm": 0.0, "theta_deg": 0.0, "d_mm": 0.0}


def taken_by_schema(table: dict[str, Any]) -> bool:
    return jsonschema.Draft202012Validator(SCHEMA).is_valid(table)


def taken_by_reader(table: dict[str, Any], folder: Path) -> bool:
    (folder / "own.toml").write_text(tomli_w.dumps(table), "utf-8")
    try:
        load_robot("own.toml", folder)
    except DataError:
        return False
    return True


def test_the_schema_is_one_and_has_every_key_of_the_reader() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    properties = SCHEMA["properties"]
    assert set(properties) == set(robot._KEYS)
    limits = {f"{end}_{unit}" for end in ("min", "max") for unit in ("deg", "mm")}
    assert set(properties["link"]["items"]["properties"]) == set(joint_kinds._KEYS) | limits
    matrices = properties["joint_matrices"]["additionalProperties"]["properties"]
    assert set(matrices) == set(joint_kinds.KEYS)


@pytest.mark.parametrize("name", built_in_robots())
def test_every_robot_of_the_library_follows_it(name: str) -> None:
    assert taken_by_schema(tomllib.loads((BUILT_IN / f"{name}.toml").read_text("utf-8")))


def put(*path: str | int) -> Callable[[Any], Callable[[dict[str, Any]], None]]:
    def value_of(value: Any) -> Callable[[dict[str, Any]], None]:
        def change(table: dict[str, Any]) -> None:
            at: Any = table
            for step in path[:-1]:
                at = at[step]
            if value is None:
                del at[path[-1]]
            else:
                at[path[-1]] = value

        return change

    return value_of


SAME = {
    "as it is": (put("name")("other"), True),
    "a track": (put("link", 0)(SLIDES | {"min_mm": 0.0, "max_mm": 900.0}), True),
    "a track without limits": (put("link", 0)(SLIDES), False),
    "a track in degrees": (put("link", 0)(SLIDES | {"min_deg": 0.0, "max_deg": 9.0}), False),
    "limits of a slide": (put("link", 0, "max_mm")(3.0), False),
    "another kind": (put("link", 0, "joint")("slips"), False),
    "no alpha": (put("link", 0, "alpha_deg")(None), False),
    "a mistyped key": (put("link", 0, "min_degg")(3.0), False),
    "a mistyped key above": (put("paralel_axes")([3]), False),
    "an axis of the arm by name": (put("link", 0, "axis")("j1"), False),
    "no source": (put("source")(None), False),
    "no links": (put("link")([]), False),
    "another convention": (put("convention")("craig"), False),
    "axis 1 parallel to nothing": (put("parallel_axes")([1]), False),
    "a load without its mass": (put("loads", 0, "mass_kg")(None), False),
    "a negative mass": (put("loads", 0, "mass_kg")(-1.0), False),
    "a flat centre": (put("loads", 0, "cog_mm")([1.0, 2.0]), False),
    "a capsule of no radius": (put("capsule", 0, "radius_mm")(0.0), False),
    "a capsule with another key": (put("capsule", 0, "colour")("red"), False),
    "a matrix key": (put("joint_matrices", "fanuc-j23", "ofset_deg")([0.0] * 6), False),
    "far away": (put("link", 0, "d_mm")(2e5), False),
}


@pytest.mark.parametrize("what", SAME)
def test_both_take_and_refuse_the_same(what: str, tmp_path: Path) -> None:
    change, good = SAME[what]
    table = copy.deepcopy(GOOD)
    if what.startswith("a track"):
        del table["joint_matrices"], table["base"]
    change(table)
    assert (taken_by_schema(table), taken_by_reader(table, tmp_path)) == (good, good)
