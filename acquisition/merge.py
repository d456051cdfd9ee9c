"""Several campaigns of one cell as one data set: one clock, one world frame, every reading with an id of its own.

The instrument has not been moved between them, so its readings stay in the world frame of the first campaign, as in
`acquisition.verification`: the nests measured again would add their own noise to every point. Where the nests show
that it did move, a campaign's own frame holds. Sets stay what they were: validation rows never enter a fit.
"""

from __future__ import annotations

import csv
import io
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tomli_w

from acquisition.cell import Cell, cell_of_record
from acquisition.errors import RecordError
from acquisition.export import export
from acquisition.individuals import Acceptance, Individual, individuals_of
from acquisition.series import SeriesOfSets
from acquisition.store import Store
from acquisition.verification import INSTRUMENT_MOVED_MM, nests_off, read_landings, world_of
from acquisition.world_frame import WorldFrame
from calib.convert.table import Table

_POINT = ("x_mm", "y_mm", "z_mm")
_TURN = ("rot_w", "rot_x", "rot_y", "rot_z")


@dataclass(frozen=True)
class Part:
    """A later campaign: its data set as exported, by how much later than the first its clock began, s, and the world
    frame its points were exported in; None where the instrument was moved, and that frame is the one that holds."""

    data: Path
    later_s: float
    own: WorldFrame | None


def export_together(records: Sequence[Path], out: Path, accepted: Acceptance | None = None) -> Path:
    """Write the data set of several records of one cell, the first of which has the clock and the world frame.

    The calendar tells how much later each of the others began. accepted: another robot, as in `merge`.
    Raises RecordError, OtherIndividual, StorageError, OSError.
    """
    first, *others = records
    with TemporaryDirectory() as name:
        folder = Path(name)
        exported = [export(record, folder / f"{i}.csv") for i, record in enumerate(records)]
        began_s, cell = _began(first)
        if cell.instrument.measures_lengths:  # the balls are the world of each
            world = WorldFrame(np.eye(3), np.zeros(3))
            frames: list[WorldFrame | None] = [None] * len(others)
        else:
            world = world_of(first)
            devices = individuals_of(first)
            frames = [frame_of_part(record, world, cell.nests, devices) for record in others]
        parts = [
            Part(data, _began(record)[0] - began_s, own)
            for record, data, own in zip(others, exported[1:], frames, strict=True)
        ]
        return merge(exported[0], world, parts, out, accepted)


def frame_of_part(
    record: Path,
    world: WorldFrame,
    nests_mm: Mapping[str, Sequence[float]],
    devices: Mapping[str, Individual],
) -> WorldFrame | None:
    """World frame of a later record; None where its nests show that the instrument was moved, or it is another one.

    devices: those of the record whose frame is `world`. Raises RecordError.
    """
    seen = read_landings(record)
    if seen.of_another_instrument(devices) or nests_off(seen, world, nests_mm) > INSTRUMENT_MOVED_MM:
        return None
    return seen.own


def _began(record: Path) -> tuple[float, Cell]:
    """When a record's clock began, s on the clock that its cell runs by, and its cell."""
    store = Store.open(record, writer=False)
    try:
        row = store.campaign
        cell = cell_of_record(row["cell"], str(store.database.path))
    finally:
        store.close()
    return row["started_utc"] * (cell.time_scale if row["simulated"] else 1.0), cell


def merge(
    first: Path, world: WorldFrame, parts: Sequence[Part], out: Path, accepted: Acceptance | None = None
) -> Path:
    """Write `out` and its header: the rows of the data set `first` and of all `parts`, points in the frame `world`.

    Ids of the parts get the number of their campaign in front (2-17). Readings of each pair of robot and instrument
    are a series. accepted: another robot than that of `first`, which is refused otherwise.
    Raises RecordError where a part comes from another kind of robot, tool or instrument, OtherIndividual, OSError.
    """
    header = tomllib.loads(_header(first))
    series = SeriesOfSets(header, str(first), accepted)
    rows = series.named(header, _rows(first))
    for number, part in enumerate(parts, start=2):
        other = tomllib.loads(_header(part.data))
        if other.get("simulated") != header.get("simulated"):
            raise RecordError("simulated and real readings do not belong into one data set")
        if _setup(other) != _setup(header):
            raise RecordError(f"{part.data}: was not measured in the cell of {first}")
        series.join(other, str(part.data))
        rows += series.named(other, _brought(part, number, world))
    if len({row["series"] for row in rows}) == 1:
        for row in rows:
            del row["series"]
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = tomli_w.dumps(header | series.header)
    Table({name: [row.get(name, "") for row in rows] for name in names}, table).write(out)
    return out


def _brought(part: Part, number: int, world: WorldFrame) -> list[dict[str, str]]:
    """The rows of a part on the clock and in the frame of the first campaign."""
    rows = _rows(part.data)
    for row in rows:
        row["reading_id"] = f"{number}-{row['reading_id']}"
        if row["t_s"]:
            row["t_s"] = f"{float(row['t_s']) + part.later_s:.3f}"
        if row.get("x_mm") and part.own is not None:
            point = world.to_world(part.own.to_tracker(np.array([float(row[name]) for name in _POINT])))
            row.update({name: f"{x:.6f}" for name, x in zip(_POINT, point.tolist(), strict=True)})
        if row.get("rot_w") and part.own is not None:
            back = WorldFrame(part.own.rotation.T, np.zeros(3))
            turn = world.turned_to_world(back.turned_to_world([float(row[name]) for name in _TURN]))
            row.update({name: f"{x:.9f}" for name, x in zip(_TURN, turn.tolist(), strict=True)})
    return rows


def _rows(data: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(data.read_text(encoding="utf-8"))))


def _header(data: Path) -> str:
    return data.with_suffix(".toml").read_text(encoding="utf-8")


def _setup(header: Mapping[str, Any]) -> dict[str, Any]:
    """What must be the same: all but the individual devices, and where the instrument stands, which every campaign
    finds by its own nests."""
    table = {key: value for key, value in header.items() if key != "device"}
    table["noise"] = {key: value for key, value in header["noise"].items() if key != "station_mm"}
    return table
