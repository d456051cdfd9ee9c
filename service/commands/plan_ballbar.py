"""`truepose plan-ballbar`: where the base balls of a ballbar hexapod should be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import RenderableType

from acquisition import Cell, read_cell
from acquisition.campaign import Hexapod, Placement, Reached, best_first, grid
from calib.errors import DataError
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed import tables
from service.printed.terminal import Terminal

FORMAT = "truepose-placements/1"
MOST = 20_000  # placements of a search
_TRIED = 5  # times as many placements are proven as are shown

Range = tuple[float, float, float]


def plan_ballbar(
    cell: Annotated[Path, typer.Argument(metavar="CELL.toml", help="A cell with a ballbar.")],
    x: Annotated[Range, typer.Option(metavar="LOW HIGH STEP", help="Shifts along x, mm.")] = (0.0, 0.0, 1.0),
    y: Annotated[Range, typer.Option(metavar="LOW HIGH STEP", help="Shifts along y, mm.")] = (0.0, 0.0, 1.0),
    z: Annotated[Range, typer.Option(metavar="LOW HIGH STEP", help="Shifts along z, mm.")] = (0.0, 0.0, 1.0),
    turn: Annotated[
        Range, typer.Option(metavar="LOW HIGH STEP", help="Turns about the vertical through the balls, deg.")
    ] = (0.0, 0.0, 1.0),
    base: Annotated[
        str | None, typer.Option(metavar="B1,B2,B3", help="The balls; default: the first three nests.")
    ] = None,
    zone: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            metavar="X Y Z RADIUS",
            help="Rank by the uncertainty predicted in this sphere of the world, mm, and not by the number of poses.",
        ),
    ] = None,
    offset_deg: Annotated[
        float, typer.Option(min=0.1, max=30.0, help="From how far below every joint arrives at its pose.")
    ] = 5.0,
    show: Annotated[int, typer.Option(min=1, max=50, help="Placements that are proven and listed.")] = 5,
    json: options.Json = None,
) -> None:
    """Find where the base balls should be. From there the arm reaches most stances of the ballbar's legs."""
    options.check_outputs({"--json": json}, inputs=(cell,))
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        the_cell = read_cell(cell)
        hexapod = _hexapod(the_cell, cell, base)
        shifts = [_steps(name, each) for name, each in (("--x", x), ("--y", y), ("--z", z))]
        turns = _steps("--turn", turn)
        if (count := len(turns) * int(np.prod([len(each) for each in shifts]))) > MOST:
            raise DataError(f"asks for {count} placements.", do=f"Ask for {MOST} at most.", key="--turn")
        places = None if zone is None else hexapod.places_in(zone[:3], zone[3])
        wanted = grid(shifts, turns)
        terminal.say(f"looking at {len(wanted)} placements")
        found = best_first(hexapod.survey(wanted, progress=_tenths(terminal, len(wanted))))
        proven, u = [], []
        finalists = _finalists(hexapod, found, show)
        terminal.say(f"proving the best {len(finalists)}")
        for each in finalists:
            proven.append(hexapod.prove(each, offset_deg))
            u.append(
                float(hexapod.uncertainty(proven[-1], places).max())
                if places is not None and proven[-1].poses
                else np.inf
            )
        order = np.argsort(u, kind="stable") if places is not None else _by_poses(proven)
        best = [(proven[i], u[i] if np.isfinite(u[i]) else None) for i in order][:show]
        options.write_result(_document(hexapod, len(wanted), zone, best), json, terminal)
        terminal.rest()
        for shown in _tables(hexapod, best, zone):
            terminal.out.print(shown)


def _hexapod(cell: Cell, path: Path, base: str | None) -> Hexapod:
    """Raises DataError for a cell without a ballbar, and for balls that it does not have or that carry no tool."""
    if not cell.instrument.declared.measures_lengths:
        raise DataError(
            f"the {cell.instrument.name} is no ballbar.",
            do="truepose select chooses poses for a tracker.",
            file=path,
            key="instrument.driver",
        )
    names = list(cell.nests)[:3] if base is None else [name.strip() for name in base.split(",")]
    if len(set(names)) != 3 or not set(names) <= set(cell.nests):
        raise DataError(f"is '{base}'.", do=f"Name three of {', '.join(cell.nests)}.", key="--base")
    try:
        return Hexapod(cell, names, list(cell.tool.targets)[:3])
    except ValueError as error:
        raise DataError(f"{error}.", do="Correct world.nests or tool.targets.", file=path) from error


def _steps(option: str, wanted: Range) -> list[float]:
    low, high, step = wanted
    if not (np.isfinite(wanted).all() and low <= high and step > 0.0):
        raise DataError(
            f"is {low:g} {high:g} {step:g}.", do="Give LOW HIGH STEP, LOW first, STEP above zero.", key=option
        )
    return [low + i * step for i in range(int((high - low) / step + 1e-9) + 1)]


def _finalists(hexapod: Hexapod, found: Sequence[Reached], show: int) -> list[Reached]:
    """The best by stances, each set of places once, and the placement of the cell file beside them."""
    once: dict[object, Reached] = {}
    for each in found:
        once.setdefault(hexapod.same_balls(each.placement), each)
    best = list(once.values())[: _TRIED * show]
    own = once[hexapod.same_balls(Placement())]
    return best if own in best else [*best, own]


def _tenths(terminal: Terminal, total: int) -> Callable[[int], None]:
    """Says every tenth of the work, so that a log does not fill."""
    said = 0

    def progress(done: int) -> None:
        nonlocal said
        if (tenth := 10 * done // total) > said:
            said = tenth
            terminal.say(f"{done} of {total} placements")

    return progress


def _by_poses(proven: Sequence[Reached]) -> list[int]:
    ranked = best_first(proven)
    return [next(i for i, each in enumerate(proven) if each is one) for one in ranked]


def _document(
    hexapod: Hexapod, count: int, zone: Sequence[float] | None, best: Sequence[tuple[Reached, float | None]]
) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "cell": hexapod.cell.name,
        "robot": hexapod.cell.robot.model.name,
        "stances": len(hexapod.stances.flange),
        "placements": count,
        "zone_mm": None if zone is None else list(zone),
        "best": [
            {
                "shift_mm": list(each.placement.shift_mm),
                "turn_deg": each.placement.turn_deg,
                "nests_mm": {name: list(hexapod.moved(each.placement).nests[name]) for name in hexapod.base},
                "poses": each.poses,
                "configurations": each.configurations,
                "by_branch": each.by_branch,
                "max_u_mm": u,
            }
            for each, u in best
        ],
    }


def _tables(
    hexapod: Hexapod, best: Sequence[tuple[Reached, float | None]], zone: Sequence[float] | None
) -> list[RenderableType]:
    branches = [name for name in best[0][0].by_arm if any(each.by_arm[name] for each, _ in best)]
    shown = tables.grid(
        f"Placements, of {len(hexapod.stances.flange)} stances with all legs away from the flange",
        "shift x, y, z, mm",
        "turn, deg",
        "poses",
        "configurations",
        *branches,
        *([] if zone is None else ["max U, mm"]),
    )
    for each, u in best:
        shown.add_row(
            ", ".join(f"{s:g}" for s in each.placement.shift_mm),
            f"{each.placement.turn_deg:g}",
            str(each.poses),
            str(each.configurations),
            *(str(each.by_arm[name]) for name in branches),
            *([] if zone is None else ["-" if u is None else f"{u:.3f}"]),
        )
    shown.caption = (
        "Within limits with approach points, moves to and from home clear, no leg in the arm. front/up and the like: "
        "configurations. U (k = 2, worst direction) is of a model that is complete, in the frame of the balls."
    )
    shown.caption_justify = "left"
    moved = hexapod.moved(best[0][0].placement).nests
    nests = ", ".join(f"{name} = [{', '.join(f'{c:g}' for c in moved[name])}]" for name in hexapod.base)
    return [shown, f"For the first, in the cell file under [world]:  nests = {{ {nests} }}"]
