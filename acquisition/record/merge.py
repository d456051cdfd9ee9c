"""Several campaigns of one cell as one data set, with one clock, one frame and new ids.

If the instrument was not moved between them, its readings stay in the world frame of the first campaign, as in
`record.verification`. The nests measured again would add their own noise to every point. If the nests show that it did
move, a campaign keeps its own frame. Sets are kept: validation rows never enter a fit.

Each pair of one robot and one instrument is a series of the whole. The robot of a data set is one, because every robot
has its own errors. Another one is refused unless a person accepts it. The instrument may be another one. A device that
does not report its identity is assumed to be that of the first data set.
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
Pair = dict[str, Individual]  # by role; unknown ones are left out


@dataclass(frozen=True)
class CampaignPart:
    """A later campaign of a merged data set.

    Its clock began `later_s` seconds after the first. `own` is the world frame in which its points were exported. It is
    None if the instrument was moved; then that frame is kept.
    """

    data: DataTable
    later_s: float
    own: WorldFrame | None


def export_together(records: Sequence[Path], out: Path, accepted: DeviceAcceptance | None = None) -> Path:
    """Write the data set of several records of one cell.

    The first record has the clock and the world frame. The calendar states how much later the others began. `accepted`
    accepts another robot, as in `merge`.

    Raises
    ------
    RecordError
        The records do not belong together, or one has no reading.
    OtherIndividual
        Another robot was not accepted.
    StorageError
        A record cannot be read.
    OSError
        A file cannot be written.
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
    """Return the world frame of a later record, or None if the instrument changed.

    It changed if the nests show that it was moved, or if it is another one. `devices` are those of the record whose
    frame is `world`.

    Raises
    ------
    RecordError
        The record has no reading of a pose.
    """
    seen = read_landings(record)
    return seen.own if frame_holds(seen, world, nests_mm, devices) else None


def _began(record: Path) -> tuple[float, Cell]:
    """Return the start of a record's clock, s on the clock of its cell, and the cell."""
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
    """Merge the rows of `first` and of all `parts` into one data set.

    The points are in the frame `world`. Ids of the parts are preceded by the number of their campaign (2-17). Readings
    of each pair of robot and instrument are a series.

    Parameters
    ----------
    accepted
        Another robot than that of `first`; without it, another robot is refused.

    Raises
    ------
    RecordError
        A part comes from another kind of robot, tool or instrument.
    OtherIndividual
        A part comes from another robot that was not accepted.
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
    """Return the first beginning, the last end, all operators and the number of campaigns."""
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
    """Convert the rows of a part to the clock and the frame of the first campaign."""
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
    """Return the settings that must be the same in all parts.

    These exclude the individual devices, undetected errors of their protocols, position uncertainties, and the station
    of the instrument, which every campaign finds from its own nests.
    """
    table = {key: value for key, value in header.items() if key not in _OF_A_CAMPAIGN}
    table["noise"] = {key: value for key, value in header["noise"].items() if key != "station_mm"}
    return table


class SeriesOfSets:
    """The series of the data sets joined so far, from their headers.

    `accepted` accepts another robot than the first's.
    """

    def __init__(self, header: Mapping[str, Any], name: str, accepted: DeviceAcceptance | None) -> None:
        self._first, self._accepted = name, accepted
        self._pairs = _pairs_of(header)
        self._names: dict[str, str] = {}  # of series: in the data set joined last -> in the whole

    def join(self, header: Mapping[str, Any], name: str) -> None:
        """Add a data set.

        Raises
        ------
        OtherIndividual
            It comes from another robot that was not accepted.
        """
        first = next(iter(self._pairs.values()))
        self._names = {}
        for own, pair in _pairs_of(header).items():
            whole = dict(first)
            for role, each in pair.items():
                first.setdefault(role, each)  # a later set may report a device that the first does not
                whole[role] = self._known(role, each) or self._new(role, each, name)
            known = (known for known, devices in self._pairs.items() if devices == whole)
            self._names[own] = next(known, series_of(*map(whole.get, ROLES)))
            self._pairs.setdefault(self._names[own], whole)

    def named(self, header: Mapping[str, Any], rows: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
        """Return rows of the data set that was joined last, each with its series."""
        alone = next(iter(_pairs_of(header)))
        own = [row.get("series") or alone for row in rows]
        return [{**row, "series": self._names.get(name, name)} for row, name in zip(rows, own, strict=True)]

    @property
    def header(self) -> dict[str, Any]:
        """Return the table of the series for the header of the whole."""
        tables = [header_table(each, name) for name, pair in self._pairs.items() for each in pair.values()]
        return {"device": tables} if tables else {}

    def _known(self, role: str, each: Individual) -> Individual | None:
        known = (pair[role] for pair in self._pairs.values() if role in pair)
        return next((one for one in known if not one.is_other_than(each)), None)

    def _new(self, role: str, each: Individual, name: str) -> Individual:
        """Add a device that is not yet known; a robot must be accepted."""
        if role != "robot":
            return each
        if self._accepted is None or not self._accepted.names(each):
            first = next(iter(self._pairs.values()))["robot"]
            raise OtherIndividual(f"{name}: was measured with {each}, {self._first} with {first}")
        leave = {"accepted_by": self._accepted.by, "reason": self._accepted.reason}
        return Individual(**asdict(each) | leave)


def _pairs_of(header: Mapping[str, Any]) -> dict[str, Pair]:
    """Return the devices of every series; a header without devices has one series without any."""
    pairs: dict[str, Pair] = {}
    for table in header.get("device", ()):
        each = individual_of(table)
        pairs.setdefault(str(table["series"]), {})[each.role] = each
    return pairs or {series_of(None, None): {}}
