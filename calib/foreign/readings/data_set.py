"""A data set of foreign readings: columns with units in their names, and the header that the map holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from calib.convert.table import Table
from calib.errors import DataError
from calib.foreign.map.map_file import Map
from calib.foreign.readings.readings import Readings
from calib.units import DEG

_PLAIN = ("series", "set", "waypoint", "visit")


def table_of(readings: Readings, made: Map, map_path: Path | str, source: str) -> Table:
    """The readings as the columns and the header of a data set. source: the files, for the first line of the header."""
    n = len(readings)
    ids = readings.texts.get("id", ())
    unique = len(set(ids)) == n and all(ids)
    columns: dict[str, list[str]] = {"reading_id": list(ids) if unique else [str(i + 1) for i in range(n)]}
    for key in _PLAIN:
        if key in readings.texts:
            columns[key] = list(readings.texts[key])
    if "time" in readings.numbers:
        time = readings.numbers["time"]
        columns["t_s"] = _text(time - np.nanmin(time), 3)
    for name, values in zip(readings.joint_columns, readings.shown_joints.T, strict=True):
        columns[name] = _text(values, 6)
    units = dict(zip(readings.axes, readings.units, strict=True))
    for quantity, values in readings.numbers.items():
        if quantity.startswith(("read", "prev")):
            kind, axis = quantity[:4], quantity[4:]
            unit = units.get(f"j{axis}", "deg")
            name = f"j{axis}_read_{unit}" if kind == "read" else f"prev{axis}_{unit}"
            columns[name] = _text(values if unit == "mm" else values / DEG, 6)
        elif quantity.startswith("approach"):
            columns[quantity] = _text(values, 0)
    if "target" in readings.texts:
        columns["tool_target"] = list(readings.texts["target"])
    for k, axis in enumerate("xyz"):
        columns[f"{axis}_mm"] = _text(readings.points[:, k], 6)
    if np.isfinite(readings.turns).any():
        turned = np.isfinite(readings.points).all(axis=1)
        for k, part in enumerate("wxyz"):
            columns[f"rot_{part}"] = _text(np.where(turned, readings.turns[:, k], np.nan), 9)
    if "t_air" in readings.numbers:
        columns["t_air_c"] = _text(readings.numbers["t_air"], 4)
    if "pose" in readings.texts:
        columns["pose"] = list(readings.texts["pose"])
    if any(readings.rejected):
        columns["status"] = [why or "ok" for why in readings.rejected]
    header = _header(made.header, readings, map_path)
    return Table(
        columns, f"# converted from {json.dumps(source, ensure_ascii=False)}\n{tomli_w.dumps(header)}"
    )


def _header(header: Mapping[str, Any], readings: Readings, map_path: Path | str) -> dict[str, Any]:
    """The header of the map with a target for every name that was measured."""
    out = {
        key: value for key, value in header.items() if key != "holdout"
    }  # what was held out is written after it
    if readings.coupling != "none":
        out.setdefault("joint_coupling", readings.coupling)
    known = dict(out.get("tool_targets", {}))
    new = [name for name in dict.fromkeys(readings.texts.get("target", ())) if name and name not in known]
    if new and "tool" not in out.get("model", {}).get("fit", []):
        raise DataError(
            f"has no position of the targets {', '.join(new)}, and does not fit the tool.",
            do='Give each under [header.tool_targets], or add "tool" to fit under [header.model].',
            file=map_path,
            key="header.tool_targets",
        )
    out["tool_targets"] = known | {name: [0.0, 0.0, 0.0] for name in new}
    return out


def _text(values: Any, decimals: int) -> list[str]:
    return ["" if not np.isfinite(value) else f"{value:.{decimals}f}" for value in values]
