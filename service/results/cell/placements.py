"""Search of placements for the base balls of a ballbar hexapod, for command and service."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from acquisition import Cell
from acquisition.campaign import (
    BallPlacement,
    HexapodSurvey,
    ReachResult,
    best_first,
    grid,
    placement_picture,
)
from calib.array import Array
from calib.errors import DataError
from service.results.shape import ResponseBody, document_of, told

MOST = 20_000  # placements of a search
TOGETHER = 4  # placements of one plan
_TRIED = 5  # times as many placements are proven as are shown

Range = tuple[float, float, float]
Zone = tuple[float, float, float, float]


@dataclass(frozen=True)
class PlacementRequest:
    """The options of a search.

    Attributes
    ----------
    x, y, z : tuple of float
        Shifts (low, high, step), mm.
    turn : tuple of float
        Turns (low, high, step) about the vertical, deg.
    base : tuple of str or None
        Names of the balls; None for the first three nests.
    zone : tuple of float or None
        Zone in which the uncertainty is predicted: x, y, z and radius, mm.
    together : int
        Number of placements that complete each other in the zone.
    """

    x: Range = (0.0, 0.0, 1.0)
    y: Range = (0.0, 0.0, 1.0)
    z: Range = (0.0, 0.0, 1.0)
    turn: Range = (0.0, 0.0, 1.0)
    base: tuple[str, ...] | None = None
    zone: Zone | None = None
    together: int = 1
    offset_deg: float = 5.0
    show: int = 5

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> PlacementRequest:
        """Create a request from the JSON form of one."""
        plain: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in table.items()}
        return cls(**plain)


class Placed(ResponseBody):
    """One placement of the base balls."""

    shift_mm: Annotated[list[float], told("Shift from the cell file, mm.", [50.0, 0.0, 0.0])]
    turn_deg: Annotated[float, told("Turn about the vertical, deg.", 15.0)]
    nests_mm: Annotated[
        dict[str, Annotated[list[float], told("A place x, y, z, mm.", [401.223, 88.102, 310.446])]],
        told("The balls there, world, mm.", {"B1": [350.0, 0.0, 20.0]}),
    ]
    poses: Annotated[int, told("Number of stances that the arm reaches.", 61)]
    configurations: Annotated[int, told("Number of configurations in which it does.", 124)]
    by_branch: Annotated[dict[str, int], told("Number of them by branch of the arm.", {"front/up": 46})]
    max_u_mm: Annotated[float | None, told("Largest predicted U (k = 2) in the zone, mm.", 0.021)]


class PlacementsResult(ResponseBody):
    """The result of a search (`truepose-placements/1`)."""

    format: Annotated[Literal["truepose-placements/1"], told("The format.", "truepose-placements/1")]
    cell: Annotated[str, told("Name of the cell.", "lrmate-ballbar")]
    robot: Annotated[str, told("Name of the robot.", "fanuc-lrmate200ic")]
    base: Annotated[list[str], told("The balls.", ["B1", "B2", "B3"])]
    stances: Annotated[int, told("Number of stances of the legs.", 144)]
    placements: Annotated[int, told("Number of placements that were tried.", 5832)]
    zone_mm: Annotated[list[float] | None, told("The zone, mm, where one was given.", None)]
    best: Annotated[list[Placed], told("The best, first.", [])]
    plan: Annotated[list[Placed], told("Those that complete each other, in order.", [])]


@dataclass(frozen=True)
class PlacementResult:
    """The best placements, proven.

    `best` lists each with the largest U in the zone, mm, if it is used alone. `plan` lists those to be used
    together: the first with its largest U, the second with that of the first two, and so on.
    """

    hexapod: HexapodSurvey
    order: PlacementRequest
    placements: int
    best: list[tuple[ReachResult, float | None]]
    plan: list[tuple[ReachResult, float | None]]

    def picture(self) -> str:
        """Draw the placements that are shown, as SVG."""
        return placement_picture(self.hexapod, [each for each, _ in self._shown])

    @property
    def _shown(self) -> list[tuple[ReachResult, float | None]]:
        return self.plan if self.order.together > 1 else self.best

    def document(self) -> dict[str, Any]:
        """Build the document of the result, for JSON."""
        hexapod = self.hexapod
        result = PlacementsResult(
            format="truepose-placements/1",
            cell=hexapod.cell.name,
            robot=hexapod.cell.robot.model.name,
            base=list(hexapod.base),
            stances=len(hexapod.stances.flange),
            placements=self.placements,
            zone_mm=None if self.order.zone is None else list(self.order.zone),
            best=[self._one(*each) for each in self.best],
            plan=[self._one(*each) for each in self.plan],
        )
        return document_of(result)

    def _one(self, each: ReachResult, u: float | None) -> Placed:
        nests = self.hexapod.moved(each.placement).nests
        return Placed(
            shift_mm=list(each.placement.shift_mm),
            turn_deg=each.placement.turn_deg,
            nests_mm={name: list(nests[name]) for name in self.hexapod.base},
            poses=each.poses,
            configurations=each.configurations,
            by_branch=each.by_branch,
            max_u_mm=u,
        )


def wanted_of(order: PlacementRequest) -> list[BallPlacement]:
    """List the placements of a request.

    Raises
    ------
    DataError
        An option is invalid, or there are too many placements; the error names the option.
    """
    shifts = [_steps(f"--{name}", each) for name, each in (("x", order.x), ("y", order.y), ("z", order.z))]
    turns = _steps("--turn", order.turn)
    if (count := len(turns) * int(np.prod([len(each) for each in shifts]))) > MOST:
        raise DataError(f"asks for {count} placements.", do=f"Ask for {MOST} at most.", key="--turn")
    if order.together > 1 and order.zone is None:
        raise DataError(
            "needs a zone in which placements complete each other.", do="Give --zone.", key="--group-size"
        )
    return grid(shifts, turns)


def found_for(
    cell: Cell,
    order: PlacementRequest,
    file: Path,
    say: Callable[[str], None],
    progress: Callable[[int, int], None],
) -> PlacementResult:
    """Search for the best placements.

    Parameters
    ----------
    say : callable
        Called with the name of each step.
    progress : callable
        Called with the number of placements done and the number of all.

    Raises
    ------
    DataError
        An option, the balls or the instrument do not suit a search, or the robot has no inverse kinematics in closed
        form.
    ConfigError
        The arm does not reach the zone.
    """
    hexapod, wanted = _hexapod(cell, file, order.base), wanted_of(order)
    places = None if order.zone is None else hexapod.places_in(order.zone[:3], order.zone[3])
    say(f"looking at {len(wanted)} placements")
    surveyed = best_first(hexapod.survey(wanted, progress=lambda done: progress(done, len(wanted))))
    finalists = _finalists(hexapod, surveyed, order.show)
    say(f"proving the best {len(finalists)}")
    proven = [hexapod.prove(each, order.offset_deg) for each in finalists]
    u = [_largest(hexapod, [each], places) for each in proven]
    ranks = np.argsort(u, kind="stable") if places is not None else _by_poses(proven)
    best = [(proven[i], _finite(u[i])) for i in ranks]
    plan = [] if places is None else _together(hexapod, best, places, order.together)
    return PlacementResult(hexapod, order, len(wanted), best[: order.show], plan)


def _together(
    hexapod: HexapodSurvey, best: Sequence[tuple[ReachResult, float | None]], places: Array, count: int
) -> list[tuple[ReachResult, float | None]]:
    """Choose placements that complete each other, starting with the best one.

    Each next one lowers the largest U most when added to those already chosen.
    """
    plan = list(best[:1])
    left = [each for each, _ in best[1:] if each.poses]
    while left and len(plan) < count:
        chosen = [each for each, _ in plan]
        u = [_largest(hexapod, [*chosen, each], places) for each in left]
        plan.append((left.pop(int(np.argmin(u))), _finite(min(u))))
    return plan


def _largest(hexapod: HexapodSurvey, reached: Sequence[ReachResult], places: Array | None) -> float:
    if places is None or not all(each.poses for each in reached):
        return np.inf
    return float(hexapod.uncertainty(reached, places).max())


def _finite(u: float) -> float | None:
    return float(u) if np.isfinite(u) else None


def _hexapod(cell: Cell, path: Path, base: tuple[str, ...] | None) -> HexapodSurvey:
    """Create the hexapod of a search.

    Raises
    ------
    DataError
        The cell has no ballbar, or the balls are not in it, or they do not make a hexapod with its tool.
    """
    if not cell.instrument.declared.measures_lengths:
        raise DataError(
            f"the {cell.instrument.name} is not a ballbar.",
            do="truepose select chooses poses for a tracker.",
            file=path,
            key="instrument.driver",
        )
    names = tuple(cell.nests)[:3] if base is None else base
    if not 3 <= len(set(names)) == len(names) <= 4 or not set(names) <= set(cell.nests):
        raise DataError(
            f"is '{','.join(names)}'.", do=f"Name three or four of {', '.join(cell.nests)}.", key="--base"
        )
    try:
        return HexapodSurvey(cell, names, list(cell.tool.targets)[:3])
    except ValueError as error:
        raise DataError(f"{error}.", do="Correct world.nests or tool.targets.", file=path) from error


def _steps(option: str, wanted: Range) -> list[float]:
    low, high, step = wanted
    if not (np.isfinite(wanted).all() and low <= high and step > 0.0):
        raise DataError(
            f"is {low:g} {high:g} {step:g}.", do="Give LOW HIGH STEP, LOW first, STEP above zero.", key=option
        )
    if (high - low) / step > MOST:
        raise DataError(f"asks for more than {MOST} placements.", do="Take larger steps.", key=option)
    return [low + i * step for i in range(int((high - low) / step + 1e-9) + 1)]


def _finalists(hexapod: HexapodSurvey, found: Sequence[ReachResult], show: int) -> list[ReachResult]:
    """Select the best placements by number of stances, each set of ball positions once.

    The placement of the cell file is always included.
    """
    once: dict[object, ReachResult] = {}
    for each in found:
        once.setdefault(hexapod.same_balls(each.placement), each)
    best = list(once.values())[: _TRIED * show]
    own = once[hexapod.same_balls(BallPlacement())]
    return best if own in best else [*best, own]


def _by_poses(proven: Sequence[ReachResult]) -> list[int]:
    ranked = best_first(proven)
    return [next(i for i, each in enumerate(proven) if each is one) for one in ranked]
