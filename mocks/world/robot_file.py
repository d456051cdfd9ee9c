"""Simple reader of robot files (`truepose-robot/1`), independent of the program's reader.

Values that a file does not state are chosen here. Compliances are such that gravity turns a joint by `SAG_DEG`
at most.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any

from mocks.world.draw import torque_range
from mocks.world.robots import Counting, Link, Load, Robot

SAG_DEG = 0.04  # a new arm with its load, joint by joint
_WIDEST_DEG = 180.0  # poses are drawn within one turn
_LIGHT = 1000.0  # N.mm: what loads a joint less does not bend it


def table_of(name: str) -> dict[str, Any]:
    """Return the robot file of this name in the library.

    Raises
    ------
    ValueError
        There is none.
    """
    calib = find_spec("calib")  # found, not imported
    folder = Path(calib.origin).parent / "arm" / "robots" if calib and calib.origin else Path()
    names = sorted(path.stem for path in folder.glob("*.toml"))
    if name not in names:
        raise ValueError(f"robot {name!r} is not one of {names}")
    return tomllib.loads((folder / f"{name}.toml").read_text(encoding="utf-8"))


def robot_of(
    table: Mapping[str, Any],
    coupling: str | None = None,
    limits_deg: Sequence[Sequence[float]] | None = None,
) -> Robot:
    """Return the robot of a parsed robot file.

    Parameters
    ----------
    coupling : str, optional
        Name of the joint matrix in use. Default: the only one.
    limits_deg : sequence of shape (N, 2), optional
        Limits within which the robot is driven. Default: those of the file.

    Raises
    ------
    KeyError, ValueError, TypeError
        The table is no robot file.
    """
    links = tuple(_link(entry) for entry in table["link"])
    limits = tuple(
        (float(entry[f"min_{unit}"]), float(entry[f"max_{unit}"]))
        for entry, unit in zip(table["link"], ("mm" if link.slides else "deg" for link in links), strict=True)
    )
    behind = 1 if table["convention"] == "dh" else 0
    robot = Robot(
        name=str(table["name"]),
        convention=str(table["convention"]),
        links=links,
        loads=tuple(_load(entry) for entry in table.get("loads", ())),
        limits_deg=limits,
        range_deg=(),
        compliance=(0.0,) * len(links),
        carries_tool=False,
        twisted=tuple(int(k) - behind for k in table.get("parallel_axes", ())),
        counting=_counting(table.get("joint_matrices", {}), coupling),
        axes=_axes(table["link"]),
        shown=str(table["name"]).removeprefix(f"{str(table['maker']).lower()}-").upper(),
    )
    return _drawn(robot, limits_deg or limits)


def _drawn(robot: Robot, limits: Sequence[Sequence[float]]) -> Robot:
    """Return the robot with the ranges of its poses, and the compliances that follow from them."""
    counted = [
        (low, high) if link.slides else (max(low, -_WIDEST_DEG), min(high, _WIDEST_DEG))
        for (low, high), link in zip(limits, robot.links, strict=True)
    ]
    middle = robot.counting.to_model([0.5 * (low + high) for low, high in counted])
    # Of the model's joints the range about the same middle: some of it the controller would not go to.
    ranges = tuple(
        (q - 0.5 * (high - low), q + 0.5 * (high - low))
        for q, (low, high) in zip(middle, counted, strict=True)
    )
    drawn = replace(robot, range_deg=ranges)
    largest = torque_range(drawn, drawn.loads)
    return replace(
        drawn,
        compliance=tuple(
            0.0 if link.slides or torque < _LIGHT else math.radians(SAG_DEG) / torque
            for link, torque in zip(robot.links, largest, strict=True)
        ),
    )


def _link(entry: Mapping[str, Any]) -> Link:
    numbers = (float(entry[key]) for key in ("alpha_deg", "a_mm", "theta_deg", "d_mm"))
    return Link(*numbers, slides=entry.get("joint", "turns") == "slides")


def _load(entry: Mapping[str, Any]) -> Load:
    x, y, z = (float(v) for v in entry["cog_mm"])
    return Load(int(entry["link"]), float(entry["mass_kg"]), (x, y, z))


def _counting(matrices: Mapping[str, Any], coupling: str | None) -> Counting:
    if coupling is None and len(matrices) == 1:
        (coupling,) = matrices
    if coupling is None or coupling == "none":
        return Counting()
    entry = matrices[coupling]
    rows = tuple(tuple(float(x) for x in row) for row in entry["matrix"])
    nought = [0.0] * len(rows)
    shifts = zip(entry.get("offset_deg", nought), entry.get("offset_mm", nought), strict=True)
    return Counting(rows, tuple(float(deg) + float(mm) for deg, mm in shifts))


def _axes(links: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    number = count(1)
    return tuple(str(entry["axis"]) if "axis" in entry else f"j{next(number)}" for entry in links)
