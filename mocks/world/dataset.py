"""The format of a data set: rows, TOML header as a dict, CSV text, atomic files.

Rows are by column name, and the names contain the units. The format is written here a second time, independent
of the reader.
"""

from __future__ import annotations

import csv
import io
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mocks.world.scaling import Reading
from mocks.world.world import World


def row_of(world: World, order: int, kind: str, reading: Reading) -> dict[str, Any]:
    """Measure a point and return its row of the data set."""
    state, target = reading
    row: dict[str, Any] = {"reading_id": order, "set": kind, "t_s": state.t_s}
    for i, q in enumerate(state.joints_deg, start=1):
        row[f"j{i}_deg"] = q
    for i, side in enumerate(state.sides, start=1):
        row[f"approach{i}"] = side
    for i, q in enumerate(state.previous_deg, start=1):
        row[f"prev{i}_deg"] = q
    row["tool_target"] = target
    x, y, z = world.measured_point(state, target)
    row |= {"x_mm": round(x, 6), "y_mm": round(y, 6), "z_mm": round(z, 6)}
    return row | {"t_air_c": state.t_air_c, "status": "ok"}


def header_of(world: World, declared: float, fit: list[str]) -> dict[str, Any]:
    """Return the TOML header as a dict; `declared` is the ratio of declared to true noise."""
    header: dict[str, Any] = {
        "format": "truepose-dataset/1",
        "robot": world.robot.name,
        "instrument": "faro-ion",
        "simulated": True,
        "world": "nominal",
        "joint_coupling": "none",
        "gravity_base": [0.0, 0.0, -9.81],
        "model": {"fit": fit},
        "noise": {
            "kind": "tracker",
            "station_mm": [float(v) for v in world.station],
            "range_mm": declared * world.noise.range_mm,
            "range_ppm": declared * world.noise.range_ppm,
            "transverse_mm": declared * world.noise.transverse_mm,
            "transverse_ppm": declared * world.noise.transverse_ppm,
            "repeatability_deg": declared * world.repeatability_deg,
        },
        "tool_targets": {name: list(point) for name, point in world.targets.items()},
    }
    if tuple(world.loads) != world.robot.loads:
        header["loads"] = [
            {"link": load.link, "mass_kg": load.mass_kg, "cog_mm": list(load.cog_mm)} for load in world.loads
        ]
    return header


def csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows as the contract's CSV: comma, header row, decimal point."""
    buffer = io.StringIO(newline="")
    writer = csv.DictWriter(buffer, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()


def write_atomically(path: Path, text: str) -> None:
    """Write UTF-8 `text` so that `path` is either the old file or the whole new one."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="") as file:
            file.write(text)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
