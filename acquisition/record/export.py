"""The data set of a record: `OUT.csv` and `OUT.toml` (`truepose-dataset/1`).

Each file is written completely or not at all. The data set has:

- points and orientations in the world frame of the nests, or distances to the balls on the base
- joints as commanded, with the approach point before them and the side of approach, and the controller's read-back
- abandoned readings as `rejected:REASON` without a point, and replaced readings with their point
- `station`, which counts the places of the instrument, if there were several
- `[[device]]` in the header, which lists robot and instrument; if there were several, each pair is a separate series
- `unprotected`, the errors that the protocols of the devices could not detect

Distances between two balls of one body have no joints. A record in which a row no longer agrees with its checksum is
refused. `export_events` writes the events of a record as JSON lines. `DataTable` is a data set in memory: the cells as
they are written, and the header.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import tomli_w

from acquisition.cell.cell import MADE_MM, TAUGHT_MM, Cell, cell_of_record
from acquisition.errors import RecordError
from acquisition.record.device_serials import ROLES, Individual, Individuals, header_table, series_of
from acquisition.record.readings import Numbers, Reading, readings_of, spans_of
from acquisition.record.store import RecordStore
from acquisition.record.touches import taught_of
from calib.convert import ConvertedTable
from calib.data import DEFAULT_GROUPS, OTHER, Dataset, dataset_of, header_of
from calib.text import PARQUET, TextTable, Vector, replace_file

_WEAKNESSES = """
SELECT json_extract(data, '$.role') AS role, json_extract(data, '$.weakness') AS weakness FROM event
WHERE kind = 'connected' AND weakness <> '' GROUP BY role, weakness ORDER BY min(id)
"""

# Who gave commands and answered prompts, in order, without the watchdog of a lease; and
# when the readings began and ended.
_OPERATORS = """
SELECT who FROM (SELECT by AS who, utc FROM command UNION ALL
                 SELECT answered_by, answered_utc FROM prompt WHERE answered_by IS NOT NULL)
WHERE who <> '' AND who NOT LIKE 'watchdog of %' GROUP BY who ORDER BY min(utc)
"""

_TO_COME = """
SELECT count(*) FROM pose WHERE kind = 'pose' AND replaced_by IS NULL AND status IN ('planned', 'deferred')
"""

_MEASURED = "SELECT min(began_utc), max(ended_utc) FROM attempt WHERE kind = 'measure' AND status = 'good'"


def export_events(record_dir: Path, out: Path) -> int:
    """Write every event of a record, oldest first, one JSON object per line.

    Returns the number of events.

    Raises
    ------
    RecordError
        There is no record, or it is damaged.
    StorageError
        The record cannot be read.
    OSError
        The file cannot be written.
    """
    store = RecordStore.open(record_dir, writer=False)
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
    """Write the data set of a record, finished or not, and return the path of its CSV.

    Raises
    ------
    RecordError
        There is no record, or no reading in it.
    StorageError
        The record cannot be read.
    OSError
        A file cannot be written.
    """
    return table_of(record_dir).write(out)


def table_of(record_dir: Path) -> DataTable:
    """Return the data set of a record, finished or not.

    Raises
    ------
    RecordError
        There is no record, or no reading in it.
    StorageError
        The record cannot be read.
    """
    with RecordStore.reading(record_dir) as store:
        simulated = bool(store.campaign["simulated"])
        rows, spans = readings_of(store), spans_of(store)
        cell = cell_of_record(store.campaign["cell"], str(store.database.path))
        taught = taught_of(store, cell)
        world = store.world
        individuals = Individuals(store).all()
        unprotected = "; ".join(f"{role}: {weakness}" for role, weakness in store.database.query(_WEAKNESSES))
        ((began, ended),) = store.database.query(_MEASURED)
        ((to_come,),) = store.database.query(_TO_COME)
        operators = [who for (who,) in store.database.query(_OPERATORS)]
    in_world = cell.instrument.declared.measures_lengths or world is not None
    if not in_world or not any(row.counts for row in rows):
        raise RecordError(
            f"{record_dir}: holds no reading of a pose yet",
            what_to_do=f"Continue it with: truepose campaign resume {record_dir}.",
        )
    station = cell.instrument.station_mm if world is None else tuple(float(x) for x in world.origin)
    rows = sorted([*rows, *spans], key=lambda row: row.id)
    of_rows, devices = _series(rows, individuals)
    placed = {} if taught is None else taught.nests_mm
    header = _header(cell, station, unprotected, placed, simulated=simulated)
    header["measured"] = {"began": _moment(began), "ended": _moment(ended), "operators": operators}
    header["readings"] = id_ranges([row.id for row in rows if row.joints])
    header |= {"not_taken": to_come} if to_come else {}
    return DataTable(str(record_dir), _columns(rows, of_rows, cell), header | {"device": devices})


def id_ranges(ids: Sequence[int]) -> str:
    """Format ascending ids as "5-28, 35-58".

    With them, a row that is deleted from the file later is detected.
    """
    starts = [i for i, n in enumerate(ids) if i == 0 or n != ids[i - 1] + 1]
    return ", ".join(f"{ids[a]}-{ids[b - 1]}" for a, b in zip(starts, [*starts[1:], len(ids)], strict=True))


def planned_header(cell: Cell) -> dict[str, Any]:
    """Return the header that readings of a cell would have.

    The instrument is at the station of the cell file.
    """
    return _header(cell, cell.instrument.station_mm, "", {}, simulated=False)


def _series(
    rows: list[Reading], individuals: dict[int, Individual]
) -> tuple[list[str], list[dict[str, str]]]:
    """Return the series of each row, and the devices of all series.

    Robot and instrument of a row determine its series.
    """
    # a row from before devices were written down was measured with the first
    first = {role: next((n for n, each in individuals.items() if each.role == role), 0) for role in ROLES}
    devices = [
        [individuals.get(row.robot or first["robot"]), individuals.get(row.instrument or first["instrument"])]
        for row in rows
    ]
    names = [series_of(*pair) for pair in devices]
    tables = [
        header_table(each, name)
        for name, pair in dict(zip(names, devices, strict=True)).items()
        for each in pair
        if each is not None
    ]
    return names, tables


def _columns(rows: list[Reading], series: list[str], cell: Cell) -> dict[str, list[str]]:
    columns: dict[str, list[str]] = {
        "reading_id": [str(row.id) for row in rows],
        **({"series": series} if len(set(series)) > 1 else {}),
        "set": [row.set_name for row in rows],
        "t_s": [_text(row.t_s, 3) for row in rows],
        "visit": ["" if row.arrival is None else str(row.arrival) for row in rows],
    }
    robot = cell.robot.model
    read_back = [f"{axis}_read_{unit}" for axis, unit in zip(robot.axes, robot.units, strict=True)]
    columns |= _spread(list(robot.joint_columns), [row.joints for row in rows], 6)
    columns |= _spread(read_back, [row.reached for row in rows], 5)
    columns |= _spread(list(robot.approach_columns), [row.sides for row in rows], 0)
    columns |= _spread(list(robot.previous_columns), [row.approach for row in rows], 6)
    columns["tool_target"] = [row.target if row.target in cell.tool.targets else "" for row in rows]
    if any(row.base_target is not None for row in rows):
        columns |= _balls(rows, cell)
        columns["length_mm"] = [_text(row.length_mm, 6) for row in rows]
    else:
        columns |= _spread(["x_mm", "y_mm", "z_mm"], [row.world for row in rows], 6)
        if any(row.turn is not None for row in rows):
            columns |= _spread(["rot_w", "rot_x", "rot_y", "rot_z"], [row.turn for row in rows], 9)
    columns["t_air_c"] = [_text(row.t_air_c, 3) for row in rows]
    if len({row.station for row in rows}) > 1:
        columns["station"] = [str(row.station) for row in rows]
    columns["status"] = ["ok" if row.counts else f"rejected:{row.reason}" for row in rows]
    return columns


def _balls(rows: list[Reading], cell: Cell) -> dict[str, list[str]]:
    """Return the columns for the second ends of distances.

    `other_target` is the second ball of one body (`calib.data.spans`).
    """
    legs = [row.joints != () for row in rows]
    base = [
        row.base_target if leg else row.target * (row.target in cell.nests)
        for row, leg in zip(rows, legs, strict=True)
    ]
    columns = {"base_target": [name or "" for name in base]}
    if not all(legs):
        columns[OTHER] = ["" if leg else row.base_target or "" for row, leg in zip(rows, legs, strict=True)]
    return columns


def _spread(names: list[str], rows: Sequence[Numbers | None], decimals: int) -> dict[str, list[str]]:
    """Return one column per number; a cell is empty if its row has none."""
    return {name: [_text(row[k] if row else None, decimals) for row in rows] for k, name in enumerate(names)}


def _moment(utc: float) -> str:
    """Format a time in UTC as text that sorts by time."""
    return datetime.fromtimestamp(utc, UTC).strftime("%Y-%m-%d %H:%M UTC")


def _text(value: float | None, decimals: int) -> str:
    if value is None or not math.isfinite(value):
        return ""
    return f"{value:.{decimals}f}"


def noise_table(cell: Cell, station_mm: tuple[float, ...]) -> dict[str, Any]:
    """Return the [noise] table of a header.

    `station_mm` is the station from which points are measured, mm, in their frame.
    """
    noise = cell.instrument.noise
    slides = {"repeatability_mm": cell.robot.repeatability_mm} if cell.robot.model.slides else {}
    robot = {"repeatability_deg": cell.robot.repeatability_deg, **slides}
    if cell.instrument.declared.measures_lengths:
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


def _known(cell: Cell, touched: Mapping[str, Vector]) -> dict[str, Any]:
    """Return the known places of a header, with their uncertainty.

    These are the nests that define the frame, or the balls to which distances were measured, and the tool. The robot
    has touched the balls in `touched`, so that their uncertainty is that of a robot as delivered.
    """
    if not cell.instrument.declared.measures_lengths:
        nests = {"nests": {name: list(point) for name, point in cell.nests.items()}} if cell.nests else {}
        return ({"tool_targets_u_mm": dict(cell.tool.stated_mm)} if cell.tool.stated_mm else {}) | nests
    unstated = [name for name in cell.unstated if name not in touched]
    return {
        "base_targets": {name: list(touched.get(name, point)) for name, point in cell.nests.items()},
        "base_targets_u_mm": {
            name: TAUGHT_MM if name in touched else cell.nests_u_mm.get(name, TAUGHT_MM)
            for name in cell.nests
        },
        "tool_targets_u_mm": {name: cell.tool.stated_mm.get(name, MADE_MM) for name in cell.tool.targets},
        **({"u_mm_assumed": unstated} if unstated else {}),
    }


def _header(
    cell: Cell,
    station_mm: tuple[float, ...],
    unprotected: str,
    touched: Mapping[str, Vector],
    *,
    simulated: bool,
) -> dict[str, Any]:
    return {
        "format": "truepose-dataset/1",
        "robot": cell.robot.model.name,
        **({"robot_file": cell.robot.file} if cell.robot.file else {}),
        "instrument": cell.instrument.name,
        **({"simulated": True} if simulated else {}),
        **(
            {}
            if cell.robot.absolute_accuracy == "unknown"
            else {"absolute_accuracy": cell.robot.absolute_accuracy}
        ),
        "world": "nominal",
        "joint_coupling": cell.robot.coupling,
        "gravity_base": [0.0, 0.0, -9.81],
        "model": {"fit": list(DEFAULT_GROUPS)},
        **({"unprotected": unprotected} if unprotected else {}),
        "noise": noise_table(cell, station_mm),
        "tool_targets": {name: list(point) for name, point in cell.tool.targets.items()},
        **_known(cell, touched),
        "loads": [
            {"link": load.link, "mass_kg": load.mass_kg, "cog_mm": list(load.cog_mm)} for load in cell.loads
        ],
    }


@dataclass(frozen=True)
class DataTable:
    """The columns of a data set, all of one length, and the table of its header.

    The columns have the names of the data-set format. `name` is the record, as error messages name it.
    """

    name: str
    columns: dict[str, list[str]]
    header: dict[str, Any]

    @property
    def rows(self) -> list[dict[str, str]]:
        """The cells of every row by the name of their column."""
        return [
            dict(zip(self.columns, cells, strict=True)) for cells in zip(*self.columns.values(), strict=True)
        ]

    def dataset(self) -> Dataset:
        """Return the data set for a calibration; its files need not have been written.

        Raises
        ------
        DataError
            The data set cannot be used, as if its files were read.
        """
        path, table = Path(self.name) / "data.csv", self._as_written
        lines = list(enumerate(zip(*self.columns.values(), strict=True), start=2))  # below the names
        cells = TextTable(path, list(self.columns), lines, hashlib.sha256(table.text.encode()).hexdigest())
        return dataset_of(cells, header_of(self.header, path.with_suffix(".toml"), table.header))

    def write(self, out: Path) -> Path:
        """Write `OUT.csv` or `OUT.parquet`, and `OUT.toml`, each completely or not at all.

        Returns the path of the readings.

        Raises
        ------
        OSError
            A file cannot be written.
        """
        out = out if out.suffix == PARQUET else out.with_suffix(".csv")
        self._as_written.write(out)
        return out

    @property
    def _as_written(self) -> ConvertedTable:
        return ConvertedTable(self.columns, tomli_w.dumps(self.header))
