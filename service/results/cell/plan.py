"""The plan of a campaign as a picture and a list need it: visits, path and duration.

Lengths are in mm, in the world frame, of the nominal robot. Angles are in deg, and times in s of the campaign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np

from acquisition import Campaign, Cell
from acquisition.campaign import Visit, setup_of
from acquisition.cell import Transit, cell_of_record, targets_at
from acquisition.record import RecordStore
from acquisition.run import Forecast, forecast_of
from calib.fit import expanded
from service.results.shape import ResponseBody, told

MOST_PATHS = 400  # moves that are looked at for a detour over home; it takes some milliseconds each
_PIECES = 6  # of a move, as it is drawn

_POINT = [412.3, -120.5, 655.0]
VisitNumber = Annotated[int, told("Number of the visit in the plan, from 0 on.", 17)]


class PlannedShown(ResponseBody):
    """One planned reading."""

    id: Annotated[int | None, told("Number of the planned reading in the record; null of a dry run.", 52)]
    target: Annotated[str, told("The target on the tool, or the nest.", "T1")]
    base_target: Annotated[
        str | None, told("Of a distance: the ball to which it is measured; else null.", "B1")
    ]
    status: Annotated[str, told("planned, deferred, measured or skipped.", "measured")]
    expected_mm: Annotated[
        list[float] | None, told("Where the nominal robot has the target, mm; null of a nest.", _POINT)
    ]


class VisitShown(ResponseBody):
    """The robot at rest in one pose once."""

    number: VisitNumber
    name: Annotated[str, told("The name by which people are told of it.", "pose 9 of block 1 (calibration)")]
    kind: Annotated[str, told("pose, or nest where the arm takes no part.", "pose")]
    set: Annotated[str, told("calibration, validation, reference, repeat or nest.", "calibration")]
    joints_deg: Annotated[
        list[float], told("Joint angles, deg; empty of a nest.", [0.0, 20.0, -30.0, 0.0, 45.0, 0.0])
    ]
    seconds: Annotated[
        float | None, told("What its path, settling and readings take, s; null of a nest.", 17.9)
    ]
    readings: Annotated[list[PlannedShown], told("Its readings, in the order of the plan.", [])]


class PlanShown(ResponseBody):
    """A plan with what became of it so far."""

    format: Annotated[str, told("Name of this format.", "truepose-plan/1")]
    visits: Annotated[list[VisitShown], told("Every visit, in the order of the plan.", [])]
    path_mm: Annotated[
        list[list[float]], told("The path of the first target of the tool, as points, mm.", [_POINT])
    ]
    detours: Annotated[
        int | None, told("The number of paths over home, in a dry run of at most 400 poses; else null.", 8)
    ]
    seconds: Annotated[float, told("What the whole plan takes, s.", 5413.5)]
    noise_mm: Annotated[
        float | None,
        told("By how much two readings of one target may differ, k = 2, mm; null of a ballbar.", 0.065),
    ] = None
    expected_within_mm: Annotated[
        float | None,
        told("A reading farther from where it is expected is taken for another target, mm.", 15.0),
    ] = None


def plan_of_campaign(cell: Cell, campaign: Campaign, visits: Sequence[Visit]) -> PlanShown:
    """Create the plan of a campaign that was only checked."""
    statuses = {(v.number, k): (None, "planned") for v in visits for k in range(len(v.targets))}
    return _plan(cell, visits, statuses, Forecast.of(cell, campaign, visits))


def plan_of_record(record: Path) -> PlanShown:
    """Create the plan of a run with the status of each reading.

    Raises
    ------
    RecordError, StorageError
        The record cannot be read.
    """
    with RecordStore.reading(record) as store:
        cell = cell_of_record(store.campaign["cell"], str(record))
        planned = store.plan()
    visits: dict[int, Visit] = {}
    statuses: dict[tuple[int, int], tuple[int | None, str]] = {}
    for each in planned:
        visit = visits.setdefault(each.visit.number, each.visit)
        k = sum(1 for number, _ in statuses if number == visit.number)
        statuses[visit.number, k] = (each.id, each.status)
    # requested often: no search for detours
    return _plan(cell, list(visits.values()), statuses, forecast_of(record), looking=False)


def _plan(
    cell: Cell,
    visits: Sequence[Visit],
    statuses: Mapping[tuple[int, int], tuple[int | None, str]],
    forecast: Forecast,
    *,
    looking: bool = True,
) -> PlanShown:
    posed = [visit for visit in visits if visit.kind == "pose"]
    places = _places(cell, posed)
    done, shown = 0, []
    for visit in visits:
        readings = len(visit.targets) if visit.counted else 0
        seconds = forecast.seconds_left(done, done) - forecast.seconds_left(done + readings, done + readings)
        done += readings
        shown.append(
            VisitShown(
                number=visit.number,
                name=visit.name,
                kind=visit.kind,
                set=visit.set,
                joints_deg=list(visit.joints_deg),
                seconds=round(seconds, 1) if readings else None,
                readings=[
                    PlannedShown(
                        id=statuses[visit.number, k][0],
                        target=target,
                        base_target=base,
                        status=statuses[visit.number, k][1],
                        expected_mm=places.get(visit.number, {}).get(target),
                    )
                    for k, (target, base) in enumerate(visit.readings)
                ],
            )
        )
    path, detours = _path(cell, posed, looking and len(posed) <= MOST_PATHS)
    return PlanShown(
        format="truepose-plan/1",
        visits=shown,
        path_mm=path,
        detours=detours,
        seconds=round(forecast.total_s, 1),
        noise_mm=_noise(cell, posed),
        expected_within_mm=cell.instrument.expected_within_mm,
    )


def _noise(cell: Cell, posed: Sequence[Visit]) -> float | None:
    """Compute the U (k = 2) by which two readings of one target may differ.

    Only the noise of the instrument counts. The pose is the reference pose if there is one, otherwise the first.
    None for a ballbar.
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
    """Predict the place of each target in each visit with the nominal robot.

    Places are given to a micrometre, because residuals are taken from them.
    """
    if not posed:
        return {}
    places = np.round(targets_at(cell, np.array([visit.joints_deg for visit in posed])), 3).tolist()
    names = list(cell.tool.targets)
    return {
        visit.number: dict(zip(names, rows, strict=True)) for visit, rows in zip(posed, places, strict=True)
    }


def _path(cell: Cell, posed: Sequence[Visit], looking: bool) -> tuple[list[list[float]], int | None]:
    """Compute the path of the first target through all poses, and count the detours over home.

    The count is None if `looking` is false.
    """
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
