"""The plan of a campaign as a picture and a list need it: every visit, the path between them, and how long it takes.

Lengths mm, world frame, of the nominal robot; angles deg, times s of the campaign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from acquisition import Campaign, Cell
from acquisition.campaign import Visit, setup_of
from acquisition.cell import Transit, cell_of_record, targets_at
from acquisition.record import RecordStore
from acquisition.run import Forecast, forecast_of
from calib.fit import expanded

FORMAT = "truepose-plan/1"
MOST_PATHS = 400  # moves that are looked at for a detour over home; it takes some milliseconds each
_PIECES = 6  # of a move, as it is drawn


def plan_of_campaign(cell: Cell, campaign: Campaign, visits: Sequence[Visit]) -> dict[str, Any]:
    """The plan of a campaign that was only checked."""
    statuses = {(v.number, k): (None, "planned") for v in visits for k in range(len(v.targets))}
    return _document(cell, visits, statuses, Forecast.of(cell, campaign, visits))


def plan_of_record(record: Path) -> dict[str, Any]:
    """The plan of a run with what became of every reading. Raises RecordError, StorageError."""
    with RecordStore.reading(record) as store:
        cell = cell_of_record(store.campaign["cell"], str(record))
        planned = store.plan()
    visits: dict[int, Visit] = {}
    statuses: dict[tuple[int, int], tuple[int | None, str]] = {}
    for each in planned:
        visit = visits.setdefault(each.visit.number, each.visit)
        k = sum(1 for number, _ in statuses if number == visit.number)
        statuses[visit.number, k] = (each.id, each.status)
    return _document(
        cell, list(visits.values()), statuses, forecast_of(record), looking=False
    )  # asked for often


def _document(
    cell: Cell,
    visits: Sequence[Visit],
    statuses: Mapping[tuple[int, int], tuple[int | None, str]],
    forecast: Forecast,
    *,
    looking: bool = True,
) -> dict[str, Any]:
    posed = [visit for visit in visits if visit.kind == "pose"]
    places = _places(cell, posed)
    done, shown = 0, []
    for visit in visits:
        readings = len(visit.targets) if visit.counted else 0
        seconds = forecast.seconds_left(done, done) - forecast.seconds_left(done + readings, done + readings)
        done += readings
        shown.append(
            {
                "number": visit.number,
                "name": visit.name,
                "kind": visit.kind,
                "set": visit.set,
                "joints_deg": list(visit.joints_deg),
                "seconds": round(seconds, 1) if readings else None,
                "readings": [
                    {
                        "id": statuses[visit.number, k][0],
                        "target": target,
                        "base_target": base,
                        "status": statuses[visit.number, k][1],
                        "expected_mm": places.get(visit.number, {}).get(target),
                    }
                    for k, (target, base) in enumerate(visit.readings)
                ],
            }
        )
    path, detours = _path(cell, posed, looking and len(posed) <= MOST_PATHS)
    return {
        "format": FORMAT,
        "visits": shown,
        "path_mm": path,
        "detours": detours,
        "seconds": round(forecast.total_s, 1),
        "noise_mm": _noise(cell, posed),
        "expected_within_mm": cell.instrument.expected_within_mm,
    }


def _noise(cell: Cell, posed: Sequence[Visit]) -> float | None:
    """U (k = 2) of the distance of two readings of one target by the noise of the instrument alone; None of a ballbar.

    In the reference pose where there is one, else in the first.
    """
    if not posed or cell.instrument.declared.measures_lengths:
        return None
    visit = next((each for each in posed if each.set == "reference"), posed[0])
    noise = setup_of(cell, visit.targets[:1]).noise
    place = targets_at(cell, np.array([visit.joints_deg]))[0][
        [list(cell.tool.targets).index(visit.targets[0])]
    ]
    single = noise.of_points(place, np.full((1, 3), np.nan))
    return round(float(np.sqrt(2.0) * expanded(single)[0]), 4)


def _places(cell: Cell, posed: Sequence[Visit]) -> dict[int, dict[str, list[float]]]:
    """The place of every target in every visit by the nominal robot, to a micrometre: residuals are taken from it."""
    if not posed:
        return {}
    places = np.round(targets_at(cell, np.array([visit.joints_deg for visit in posed])), 3).tolist()
    names = list(cell.tool.targets)
    return {
        visit.number: dict(zip(names, rows, strict=True)) for visit, rows in zip(posed, places, strict=True)
    }


def _path(cell: Cell, posed: Sequence[Visit], looking: bool) -> tuple[list[list[float]], int | None]:
    """The path of the first target through all poses, and over home how often; None without looking for that."""
    if not posed:
        return [], 0
    stops: list[tuple[float, ...]] = [posed[0].joints_deg]
    look = Transit(cell).path if looking else None
    detours = 0
    for before, visit in pairwise(posed):
        last = before.waypoints[-1] if before.waypoints else before.joints_deg
        moves = [visit.approach_deg] if look is None else look(last, visit.approach_deg)
        detours += len(moves) > 1
        stops += [*moves, visit.joints_deg, *visit.waypoints]
    joints = np.array(stops)
    share = np.linspace(0.0, 1.0, _PIECES, endpoint=False)[None, :, None]
    pieces = joints[:-1, None] + share * np.diff(joints, axis=0)[:, None]  # (moves, pieces, N)
    points = targets_at(cell, np.vstack([pieces.reshape(-1, joints.shape[1]), joints[-1:]]))[:, 0]
    return np.round(points, 0).tolist(), None if look is None else detours
