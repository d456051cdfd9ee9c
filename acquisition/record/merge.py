"""Several campaigns of one cell as one data set: one clock, one world frame, every reading with an id of its own.

The instrument has not been moved between them, so its readings stay in the world frame of the first campaign, as in
`record.verification`: the nests measured again would add their own noise to every point. Where the nests show
that it did move, a campaign's own frame holds. Sets stay what they were: validation rows never enter a fit.

The series of several data sets brought into one: a pair of one robot and one instrument each.

The robot of a data set is one, because its errors are its own: another one is refused unless somebody accepts it. The
instrument may be another one. Where a device does not report who it is, it is taken for the one of the first data set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.cell.cell import Cell, cell_of_record
from acquisition.cell.world_frame import WorldFrame
from acquisition.errors import OtherIndividual, RecordError
from acquisition.record.device_serials import (
    ROLES,
    DeviceAcceptance,
    Individual,
    header_table,
    individual_of,
    individuals_of,
    series_of,
)
from acquisition.record.export import DataTable, table_of
from acquisition.record.store import RecordStore
from acquisition.record.verification import frame_holds, read_landings, world_of

_POINT = ("x_mm", "y_mm", "z_mm")
_OF_ROWS = ("readings", "not_taken")

_OF_A_CAMPAIGN = (
    "device",
    "measured",
    "unprotected",
    "base_targets_u_mm",
    "tool_targets_u_mm",
    "u_mm_assumed",
    *_OF_ROWS,
)

_TURN = ("rot_w", "rot_x", "rot_y", "rot_z")
Pair = dict[str, Individual]  # by role; what is not known is left out


@dataclass(frozen=True)
class CampaignPart:
    """A later campaign: its data set, by how much later than the first its clock began, s, and the world
    frame its points were exported in; None where the instrument was moved, and that frame is the one that holds."""

    data: DataTable
    later_s: float
    own: WorldFrame | None


def export_together(records: Sequence[Path], out: Path, accepted: DeviceAcceptance | None = None) -> Path:
    """Write the data set of several records of one cell, the first of which has the clock and the world frame.

    The calendar says how much later each of the others began. accepted: another robot, as in `merge`.
    Raises RecordError, OtherIndividual, StorageError, OSError.
    """
    first, *others = records
    whole, *added = [table_of(record) for record in records]
    began_s, cell = _began(first)
    if cell.instrument.declared.measures_lengths:  # the balls are the world of each
        world = WorldFrame(np.eye(3), np.zeros(3))
        frames: list[WorldFrame | None] = [None] * len(others)
    else:
        world = world_of(first)
        devices = individuals_of(first)
        frames = [frame_of_part(record, world, cell.nests, devices) for record in others]
    parts = [
        CampaignPart(data, _began(record)[0] - began_s, own)
        for record, data, own in zip(others, added, frames, strict=True)
    ]
    return merge(whole, world, parts, accepted).write(out)


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
    return seen.own if frame_holds(seen, world, nests_mm, devices) else None


def _began(record: Path) -> tuple[float, Cell]:
    """The start of a record's clock, s on the clock that its cell runs by, and its cell."""
    store = RecordStore.open(record, writer=False)
    try:
        row = store.campaign
        cell = cell_of_record(row["cell"], str(store.database.path))
    finally:
        store.close()
    return row["started_utc"] * (cell.time_scale if row["simulated"] else 1.0), cell


def merge(
    first: DataTable,
    world: WorldFrame,
    parts: Sequence[CampaignPart],
    accepted: DeviceAcceptance | None = None,
) -> DataTable:
    """One data set: the rows of `first` and of all `parts`, points in the frame `world`.

    Ids of the parts get the number of their campaign in front (2-17). Readings of each pair of robot and instrument
    are a series. accepted: another robot than that of `first`, which is refused otherwise.
    Raises RecordError where a part comes from another kind of robot, tool or instrument, OtherIndividual.
    """
    header = first.header
    series = SeriesOfSets(header, first.name, accepted)
    rows = series.named(header, first.rows)
    unprotected = [header.get("unprotected", "")]
    occasions = [header.get("measured")]
    for number, part in enumerate(parts, start=2):
        other = part.data.header
        if other.get("simulated") != header.get("simulated"):
            raise RecordError("simulated and real readings do not belong into one data set")
        if other.get("absolute_accuracy") != header.get("absolute_accuracy"):
            raise RecordError(
                f"{part.data.name}: was measured with another absolute_accuracy of the controller"
            )
        if _setup(other) != _setup(header):
            raise RecordError(f"{part.data.name}: was not measured in the cell of {first.name}")
        series.join(other, part.data.name)
        unprotected.append(other.get("unprotected", ""))
        occasions.append(other.get("measured"))
        rows += series.named(other, _brought(part, number, world))
    if len({row["series"] for row in rows}) == 1:
        for row in rows:
            del row["series"]
    names = list(dict.fromkeys(name for row in rows for name in row))
    weaknesses = "; ".join(dict.fromkeys(each for text in unprotected for each in text.split("; ") if each))
    unseen = {"unprotected": weaknesses} if weaknesses else {}
    measured = _measured(occasions)
    columns = {name: [row.get(name, "") for row in rows] for name in names}
    kept = {key: value for key, value in header.items() if key not in _OF_ROWS}  # of the first alone
    return DataTable(first.name, columns, kept | unseen | measured | series.header)


def _measured(occasions: Sequence[Mapping[str, Any] | None]) -> dict[str, Any]:
    """The times at which the first of the parts began and the last ended, everybody who worked on them, how many."""
    known = [each for each in occasions if each]
    if not known:
        return {}
    return {
        "measured": {
            "began": min(each["began"] for each in known),
            "ended": max(each["ended"] for each in known),
            "operators": list(dict.fromkeys(who for each in known for who in each["operators"])),
            "campaigns": sum((each or {}).get("campaigns", 1) for each in occasions),
        }
    }


def _brought(part: CampaignPart, number: int, world: WorldFrame) -> list[dict[str, str]]:
    """The rows of a part on the clock and in the frame of the first campaign."""
    rows = part.data.rows
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


def _setup(header: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that must be the same: all but the individual devices, what their wires could not see, how well
    positions are known, and where the instrument stands, which every campaign finds by its own nests."""
    table = {key: value for key, value in header.items() if key not in _OF_A_CAMPAIGN}
    table["noise"] = {key: value for key, value in header["noise"].items() if key != "station_mm"}
    return table


class SeriesOfSets:
    """The series of the data sets joined so far, from their headers. `accepted`: another robot than the first's."""

    def __init__(self, header: Mapping[str, Any], name: str, accepted: DeviceAcceptance | None) -> None:
        self._first, self._accepted = name, accepted
        self._pairs = _pairs_of(header)
        self._names: dict[str, str] = {}  # of series: in the data set joined last -> in the whole

    def join(self, header: Mapping[str, Any], name: str) -> None:
        """Add a data set. Raises OtherIndividual."""
        first = next(iter(self._pairs.values()))
        self._names = {}
        for own, pair in _pairs_of(header).items():
            whole = dict(first)
            for role, each in pair.items():
                first.setdefault(role, each)  # what the first does not report, a later one does
                whole[role] = self._known(role, each) or self._new(role, each, name)
            known = (known for known, devices in self._pairs.items() if devices == whole)
            self._names[own] = next(known, series_of(*map(whole.get, ROLES)))
            self._pairs.setdefault(self._names[own], whole)

    def named(self, header: Mapping[str, Any], rows: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
        """Rows of the data set that was joined last, each with its series."""
        alone = next(iter(_pairs_of(header)))
        own = [row.get("series") or alone for row in rows]
        return [{**row, "series": self._names.get(name, name)} for row, name in zip(rows, own, strict=True)]

    @property
    def header(self) -> dict[str, Any]:
        """The table of the series in the header of the whole."""
        tables = [header_table(each, name) for name, pair in self._pairs.items() for each in pair.values()]
        return {"device": tables} if tables else {}

    def _known(self, role: str, each: Individual) -> Individual | None:
        known = (pair[role] for pair in self._pairs.values() if role in pair)
        return next((one for one in known if not one.is_other_than(each)), None)

    def _new(self, role: str, each: Individual, name: str) -> Individual:
        """A device that is not among those known; a robot must be accepted."""
        if role != "robot":
            return each
        if self._accepted is None or not self._accepted.names(each):
            first = next(iter(self._pairs.values()))["robot"]
            raise OtherIndividual(f"{name}: was measured with {each}, {self._first} with {first}")
        leave = {"accepted_by": self._accepted.by, "reason": self._accepted.reason}
        return Individual(**asdict(each) | leave)


def _pairs_of(header: Mapping[str, Any]) -> dict[str, Pair]:
    """The devices of every series; one series without any where the header names none."""
    pairs: dict[str, Pair] = {}
    for table in header.get("device", ()):
        each = individual_of(table)
        pairs.setdefault(str(table["series"]), {})[each.role] = each
    return pairs or {series_of(None, None): {}}
