"""`truepose plan-ballbar`: where the base balls of a ballbar hexapod should be."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import RenderableType

from acquisition import read_cell
from calib.text import replace_file
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed import tables
from service.printed.terminal import Terminal
from service.results.cell.placements import (
    TOGETHER,
    PlacementRequest,
    PlacementResult,
    Range,
    Zone,
    found_for,
    wanted_of,
)


def plan_ballbar(
    cell: Annotated[Path, typer.Argument(metavar="CELL.toml", help="File of a cell with a ballbar.")],
    x: Annotated[
        Range, typer.Option(metavar="LOW HIGH STEP", help="Shifts of the base balls along x to try, mm.")
    ] = PlacementRequest.x,
    y: Annotated[
        Range, typer.Option(metavar="LOW HIGH STEP", help="Shifts of the base balls along y to try, mm.")
    ] = PlacementRequest.y,
    z: Annotated[
        Range, typer.Option(metavar="LOW HIGH STEP", help="Shifts of the base balls along z to try, mm.")
    ] = PlacementRequest.z,
    turn: Annotated[
        Range,
        typer.Option(
            metavar="LOW HIGH STEP", help="Turns of the base balls about their vertical to try, deg."
        ),
    ] = PlacementRequest.turn,
    base: Annotated[
        str | None,
        typer.Option(
            metavar="B1,B2,B3[,B4]",
            help="Names of three or four base balls; of four, each choice of three is tried. Default: the "
            "first three nests.",
        ),
    ] = None,
    zone: Annotated[
        Zone | None,
        typer.Option(
            metavar="X Y Z RADIUS",
            help="Sphere of the world, mm: rank by the uncertainty predicted in it, not by the number of poses.",
        ),
    ] = None,
    together: Annotated[
        int,
        typer.Option(
            "--group-size",
            "--together",
            min=1,
            max=TOGETHER,
            help="Number of placements in one plan, which complete each other in the zone.",
        ),
    ] = 1,
    offset_deg: Annotated[
        float,
        typer.Option(
            "--approach-deg",
            "--offset-deg",
            min=0.1,
            max=30.0,
            help="Length of the last move of every joint, from below, deg.",
        ),
    ] = PlacementRequest.offset_deg,
    show: Annotated[
        int, typer.Option(min=1, max=50, help="Number of placements to check in full and list.")
    ] = PlacementRequest.show,
    picture: Annotated[
        Path | None, typer.Option(metavar="OUT.svg", help="File for a picture of the listed placements.")
    ] = None,
    json: options.Json = None,
) -> None:
    """Find where the base balls should be. From there the arm reaches most stances of the ballbar's legs."""
    options.check_outputs({"--json": json, "--picture": picture}, inputs=(cell,))
    names = None if base is None else tuple(name.strip() for name in base.split(","))
    order = PlacementRequest(x, y, z, turn, names, zone, together, offset_deg, show)
    wanted_of(order)  # refused before anything is computed
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        found = found_for(read_cell(cell), order, cell, terminal.say, _tenths(terminal))
        if picture is not None:
            replace_file(picture, found.picture())
        options.write_result(found.document(), json, terminal)
        terminal.rest()
        for shown in _tables(found):
            terminal.out.print(shown)
        if picture is not None:
            terminal.note(f"picture: {picture}")


def _tenths(terminal: Terminal) -> Callable[[int, int], None]:
    """Return a callback that reports every tenth of the work, so that a log does not fill."""
    said = 0

    def progress(done: int, total: int) -> None:
        nonlocal said
        if (tenth := 10 * done // total) > said:
            said = tenth
            terminal.say(f"{done} of {total} placements")

    return progress


def _tables(found: PlacementResult) -> list[RenderableType]:
    hexapod, zone = found.hexapod, found.order.zone
    best = found.plan if found.order.together > 1 else found.best
    branches = [name for name in best[0][0].by_arm if any(each.by_arm[name] for each, _ in best)]
    title = "Placements that complete each other" if found.order.together > 1 else "Placements"
    shown = tables.grid(
        f"{title}, of {len(hexapod.stances.flange)} stances with all legs away from the flange",
        "shift x, y, z, mm",
        "turn, deg",
        "poses",
        "configurations",
        *branches,
        *([] if zone is None else ["max U, mm" if found.order.together == 1 else "max U so far, mm"]),
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
    lines = []
    for k, (each, _) in enumerate(best if found.order.together > 1 else best[:1], start=1):
        moved = hexapod.moved(each.placement).nests
        nests = ", ".join(f"{name} = [{', '.join(f'{c:g}' for c in moved[name])}]" for name in hexapod.base)
        which = "the first" if k == 1 else f"number {k}"
        lines.append(f"For {which}, in the cell file under [world]:  nests = {{ {nests} }}")
    return [shown, *lines]
