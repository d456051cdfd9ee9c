"""From a record to a data set: `OUT.csv` and `OUT.toml` (`truepose-dataset/1`), each written whole or not at all.

Points and turns in the world frame of the nests, or distances to the balls on the base; angles as commanded, with the
approach point before them and the side of approach; the controller's read-back beside them. Readings that were given
up stay in the file as `rejected:REASON` without a point, those that were measured again with theirs. `station` counts
the places of the instrument, where it had several. `[[device]]` in the header names robot and instrument; where there
were several of either, each pair is a series of its own. What their wires could not see stands there as `unprotected`.
A record in which a row no longer agrees with its checksum is refused. `export_events` writes what happened as JSON
lines.
"""

from __future__ import annotations

import io
import json
import math
from pathlib import Path
from typing import Any

import tomli_w

from acquisition.cell import Cell, cell_of_record
from acquisition.errors import RecordError
from acquisition.individuals import ROLES, Individual, Individuals, header_table, series_of
from acquisition.store import Store
from calib.convert.table import Table
from calib.effects.base_model import DEFAULT_GROUPS
from calib.files import replace_file

_ROWS = """
SELECT attempt.*, pose.set_name, pose.target, pose.base_target, pose.joints_deg, pose.sides, pose.approach_deg,
       pose.reason, pose.replaced_by, arrival.read_deg AS reached_deg
FROM attempt JOIN pose ON pose.id = attempt.pose LEFT JOIN attempt AS arrival ON arrival.id = attempt.arrival
WHERE pose.kind = 'pose' AND (attempt.status = 'good' OR (pose.status = 'skipped' AND attempt.id = (
      SELECT max(id) FROM attempt AS last WHERE last.pose = pose.id)))
ORDER BY attempt.id
"""


_WEAKNESSES = """
SELECT json_extract(data, '$.role') AS role, json_extract(data, '$.weakness') AS weakness FROM event
WHERE kind = 'connected' AND weakness <> '' GROUP BY role, weakness ORDER BY min(id)
"""


def export_events(record_dir: Path, out: Path) -> int:
    """Write every event of a record, oldest first, one JSON object a line. Returns how many.

    Raises RecordError, StorageError, OSError.
    """
    store = Store.open(record_dir, writer=False)
    try:
        text, number = io.StringIO(), 0
        while events := store.events(number):
            for event in events:
                text.write(json.dumps(event.as_dict()) + "\n")
            number = events[-1].id
    finally:
        store.close()
    replace_file(out, text.getvalue())
    return number


def export(record_dir: Path, out: Path) -> Path:
    """Write the data set of a record, finished or not. Returns the path of its CSV.

    Raises RecordError (no record, or no reading in it), StorageError, OSError.
    """
    with Store.reading(record_dir) as store:
        simulated = bool(store.campaign["simulated"])
        rows = [dict(row) for row in store.database.query(_ROWS)]
        cell = cell_of_record(store.campaign["cell"], str(store.database.path))
        world = store.world
        individuals = Individuals(store).all()
        unprotected = "; ".join(f"{role}: {weakness}" for role, weakness in store.database.query(_WEAKNESSES))
    placed = cell.instrument.measures_lengths or world is not None
    if not placed or not any(_counts(row) for row in rows):
        raise RecordError(
            f"{record_dir}: holds no reading of a pose yet",
            what_to_do=f"Go on with it: truepose campaign resume {record_dir}.",
        )
    station = cell.instrument.station_mm if world is None else tuple(float(x) for x in world.origin)
    out = out.with_suffix(".csv")
    of_rows, devices = _series(rows, individuals)
    header = tomli_w.dumps(_header(cell, station, unprotected, simulated=simulated) | {"device": devices})
    Table(_columns(rows, of_rows, cell.robot.model.joints), header).write(out)
    return out


def _series(
    rows: list[dict[str, Any]], individuals: dict[int, Individual]
) -> tuple[list[str], list[dict[str, str]]]:
    """Of each row the series that its robot and instrument make, and the devices of every series."""
    # a row from before devices were written down was measured with the first
    first = {role: next((n for n, each in individuals.items() if each.role == role), 0) for role in ROLES}
    devices = [[individuals.get(row[role] or first[role]) for role in ROLES] for row in rows]
    names = [series_of(*pair) for pair in devices]
    tables = [
        header_table(each, name)
        for name, pair in dict(zip(names, devices, strict=True)).items()
        for each in pair
        if each is not None
    ]
    return names, tables


def _columns(rows: list[dict[str, Any]], series: list[str], joints: int) -> dict[str, list[str]]:
    columns: dict[str, list[str]] = {
        "reading_id": [str(row["id"]) for row in rows],
        **({"series": series} if len(set(series)) > 1 else {}),
        "set": [row["set_name"] for row in rows],
        "t_s": [
            _text(row["ended_t_s"] if row["ended_t_s"] is not None else row["began_t_s"], 3) for row in rows
        ],
    }
    for name, key, decimals in (
        ("j{}_deg", "joints_deg", 6),
        ("j{}_read_deg", "reached_deg", 5),
        ("approach{}", "sides", 0),
        ("prev{}_deg", "approach_deg", 6),
    ):
        values = [json.loads(row[key]) if row[key] else [None] * joints for row in rows]
        for k in range(joints):
            columns[name.format(k + 1)] = [_text(each[k], decimals) for each in values]
    columns["tool_target"] = [row["target"] for row in rows]
    measured = [(f"{axis}_mm", f"world_{axis}_mm", 6) for axis in "xyz"]
    if any(row["world_rot_w"] is not None for row in rows):
        measured += [(f"rot_{axis}", f"world_rot_{axis}", 9) for axis in "wxyz"]
    if any(row["base_target"] is not None for row in rows):
        columns["base_target"] = [row["base_target"] for row in rows]
        measured = [("length_mm", "length_mm", 6)]
    for name, key, decimals in measured:
        columns[name] = [_text(row[key], decimals) for row in rows]
    columns["t_air_c"] = [_text(row["t_air_c"], 3) for row in rows]
    if len({row["station"] for row in rows}) > 1:
        columns["station"] = [str(row["station"]) for row in rows]
    columns["status"] = ["ok" if _counts(row) else f"rejected:{row['reason']}" for row in rows]
    return columns


def _counts(row: dict[str, Any]) -> bool:
    return row["status"] == "good" and row["replaced_by"] is None


def _text(value: float | None, decimals: int) -> str:
    if value is None or not math.isfinite(value):
        return ""
    return f"{value:.{decimals}f}"


def _noise(cell: Cell, station_mm: tuple[float, ...]) -> dict[str, Any]:
    noise = cell.instrument.noise
    robot = {"repeatability_deg": cell.robot.repeatability_deg}
    if cell.instrument.measures_lengths:
        # There are no points in such a data set; the key must be there.
        return {"kind": "isotropic", "sigma_mm": noise.length_mm, "length_mm": noise.length_mm, **robot}
    turns = {"rotation_mrad": noise.rotation_mrad} if noise.rotation_mrad > 0.0 else {}
    return {
        "kind": "tracker",
        "station_mm": list(station_mm),
        "range_mm": noise.range_mm,
        "range_ppm": noise.range_ppm,
        "transverse_mm": noise.transverse_mm,
        "transverse_ppm": noise.transverse_ppm,
        **turns,
        **robot,
    }


def _header(
    cell: Cell, station_mm: tuple[float, ...], unprotected: str, *, simulated: bool
) -> dict[str, Any]:
    balls = {"base_targets": {name: list(point) for name, point in cell.nests.items()}}
    return {
        "format": "truepose-dataset/1",
        "robot": cell.robot.model.name,
        "instrument": cell.instrument.name,
        **({"simulated": True} if simulated else {}),
        "world": "nominal",
        "joint_coupling": cell.robot.coupling,
        "gravity_base": [0.0, 0.0, -9.81],
        "model": {"fit": list(DEFAULT_GROUPS)},
        **({"unprotected": unprotected} if unprotected else {}),
        "noise": _noise(cell, station_mm),
        "tool_targets": {name: list(point) for name, point in cell.tool.targets.items()},
        **(balls if cell.instrument.measures_lengths else {}),
        "loads": [
            {"link": load.link, "mass_kg": load.mass_kg, "cog_mm": list(load.cog_mm)} for load in cell.loads
        ],
    }
