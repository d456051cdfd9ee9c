"""`truepose select`: which calibration poses to measure in a cell, and how many are worth it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich import box
from rich.console import RenderableType
from rich.table import Table

from acquisition import Cell, read_cell
from acquisition.campaign import DECIMALS, Pose, draw_poses, setup_of
from calib.data import DEFAULT_GROUPS
from calib.errors import DataError
from calib.selection import SHARE, STEP, WORTH, Candidates, Choice, Curve, candidates_of, choose, curve_of
from calib.text import replace_file
from calib.units import to_display
from service import exit_codes, wording
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.plain import finite
from service.printed import tables
from service.printed.terminal import Terminal

FORMAT = "truepose-selection/1"


def select(
    cell: Annotated[Path, typer.Argument(metavar="CELL.toml", help="The cell.")],
    out: Annotated[
        Path, typer.Option("--out", metavar="POSES.csv", help='The poses, for a block with select = "file".')
    ],
    count: Annotated[int, typer.Option(min=1, help="Poses to select.")] = 50,
    candidates: Annotated[
        int, typer.Option("--from", min=1, max=50_000, help="Candidates, drawn at random.")
    ] = 5000,
    groups: Annotated[
        str, typer.Option(metavar="NAMES", help="What the model will free, with commas between.")
    ] = ",".join(DEFAULT_GROUPS),
    targets: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Targets measured at every pose; default: all of the cell."),
    ] = None,
    offset_deg: Annotated[
        float, typer.Option(min=-30.0, max=30.0, help="From where every joint arrives at its pose.")
    ] = -5.0,
    share: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Most of the poses that may fill the joints' ranges.")
    ] = SHARE,
    wanted_u: Annotated[
        float | None,
        typer.Option(min=0.0, metavar="MM", help="Exit code 3 when the predicted U stays above."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Draws the candidates and the starts.")] = 1,
    json: options.Json = None,
) -> None:
    """Choose calibration poses by observability."""
    options.check_outputs({"--out": out, "--json": json}, inputs=(cell,))
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        the_cell = read_cell(cell)
        if the_cell.instrument.declared.measures_lengths:
            raise DataError(
                f"the {the_cell.instrument.name} measures distances; poses are chosen for points.",
                do="Use a block of kind = 'hexapod' in the campaign, it takes every stance that the arm reaches.",
                file=cell,
                key="instrument.driver",
            )
        names = _names(targets, the_cell)
        setup = setup_of(the_cell, names, [name.strip() for name in groups.split(",") if name.strip()])
        terminal.say(f"drawing {candidates} candidates")
        rng = np.random.default_rng(seed)
        drawn = draw_poses(
            the_cell, candidates, rng, offset_deg, both=False, decimals=DECIMALS, targets=names, fewest=count
        )
        terminal.say(f"selecting {count} of {len(drawn)}")
        found = candidates_of(setup, the_cell.robot.model_angles([pose.joints_deg for pose in drawn]))
        choice = choose(setup, found, count, share=share, seed=seed)
        terminal.say("predicting the uncertainty")
        curve = curve_of(found, choice.selection)
        poses = [drawn[i] for i in choice.selection]
        document = _document(the_cell, names, groups, seed, found, choice, curve, poses, wanted_u)
        options.write_result(document, json, terminal)
        replace_file(out, _csv(poses))
        terminal.rest()
        for each in (
            _summary(found, choice),
            _curve(curve, count),
            tables.warnings([*_dropped(choice), *choice.warnings, *_shortage(len(drawn), candidates)]),
        ):
            terminal.out.print(each)
        terminal.out.print(_advice(curve, wanted_u))
        terminal.note(f"poses: {out}")
    if wanted_u is not None and curve.at(count) > wanted_u:
        terminal.note(f"truepose: U of {curve.at(count):.4f} mm is above the {wanted_u:g} mm asked for.")
        raise typer.Exit(exit_codes.NOT_MET)


def _names(targets: str | None, cell: Cell) -> list[str]:
    if targets is None:
        return list(cell.tool.targets)
    names = list(dict.fromkeys(name.strip() for name in targets.split(",") if name.strip()))
    for name in names:
        if name not in cell.tool.targets:
            raise DataError(
                f"'{name}' is no target of the cell.",
                do=f"Use {', '.join(cell.tool.targets)}.",
                key="--targets",
            )
    return names


def _csv(poses: Sequence[Pose]) -> str:
    joints = len(poses[0].joints_deg)
    lines = [",".join(["target_id", *(f"j{k + 1}_deg" for k in range(joints))])]
    lines += [
        ",".join([str(i), *(f"{q:.{DECIMALS}f}" for q in pose.joints_deg)])
        for i, pose in enumerate(poses, start=1)
    ]
    return "\n".join(lines) + "\n"


def _document(
    cell: Cell,
    targets: Sequence[str],
    groups: str,
    seed: int,
    candidates: Candidates,
    choice: Choice,
    curve: Curve,
    poses: Sequence[Pose],
    wanted_u: float | None,
) -> dict[str, Any]:
    index = {int(i): place for place, i in enumerate(choice.selection, start=1)}
    o = choice.observability
    return finite(
        {
            "format": FORMAT,
            "cell": cell.name,
            "robot": cell.robot.model.name,
            "targets": list(targets),
            "groups": [name.strip() for name in groups.split(",")],
            "seed": seed,
            "candidates": len(candidates.joints),
            "poses_deg": [list(pose.joints_deg) for pose in poses],
            "filling": [index[i] for i in choice.filling],
            "observability": {"O1": o.o1, "O2": o.o2, "O3": o.o3, "O4": o.o4, "O5": o.o5},
            "efficiency": choice.efficiency,
            "efficiency_without_filling": choice.efficiency_core,
            "bound_gap": choice.gap,
            "parameters": [
                {"name": p.name, "std": to_display(float(s), p.unit), "unit": p.unit}
                for p, s in zip(candidates.parameters, choice.std, strict=True)
            ],
            "dropped": [{"name": d.name, "confounded_with": list(d.confounded_with)} for d in choice.dropped],
            "uncertainty": {
                "poses": curve.counts.tolist(),
                "max_u_mm": curve.largest.tolist(),
                "mean_u_mm": curve.mean.tolist(),
                "max_u_of_model_mm": curve.of_model.tolist(),
                "enough": curve.enough(),
                "wanted_u_mm": wanted_u,
                "reached_with": None if wanted_u is None else curve.reaches(wanted_u),
            },
            "warnings": list(choice.warnings),
        }
    )


def _summary(candidates: Candidates, choice: Choice) -> RenderableType:
    o = choice.observability
    table = Table(title="Selection", title_justify="left", box=box.SIMPLE_HEAD, show_header=False)
    n, found = len(choice.selection), len(candidates.joints)
    table.add_row(
        "poses", f"{n} of {found} candidates, {len(choice.filling)} of them fill the joints' ranges"
    )
    table.add_row("parameters", str(len(candidates.parameters)))
    table.add_row(
        "efficiency",
        f"{choice.efficiency:.3f} of the continuous D-optimal bound"
        f" ({choice.efficiency_core:.3f} without filling ranges)",
    )
    table.add_row("O1 .. O5", f"{o.o1:.4g}, {o.o2:.4g}, {o.o3:.4g}, {o.o4:.4g}, {o.o5:.4g} (scaled columns)")
    return table


def _curve(curve: Curve, count: int) -> RenderableType:
    table = Table(
        title="Predicted U of the position, k = 2, worst direction, mm",
        title_justify="left",
        box=box.SIMPLE_HEAD,
    )
    for name in ("poses", "max", "mean", "max of the model alone"):
        table.add_column(name, justify="right")
    for n, largest, mean, of_model in zip(
        curve.counts, curve.largest, curve.mean, curve.of_model, strict=True
    ):
        shown = (f"{x:.4f}" for x in (largest, mean, of_model))
        table.add_row(f"{n}", *shown, style="bold" if n == count else None)
    return table


def _dropped(choice: Choice) -> list[str]:
    return [
        f"{d.name} was dropped: "
        + (
            f"confounded with {', '.join(d.confounded_with)}."
            if d.confounded_with
            else "it moves nothing here."
        )
        for d in choice.dropped
    ]


def _shortage(found: int, asked: int) -> list[str]:
    return [] if found == asked else [f"Only {found} of {asked} candidates were found in this cell."]


def _advice(curve: Curve, wanted_u: float | None) -> str:
    enough, last = curve.enough(), int(curve.counts[-1])
    lines = [
        f"Beyond {last} poses, {STEP} more still lower the largest U by {WORTH:.0%} or more."
        if enough is None
        else f"From {enough} poses on, {STEP} more lower the largest U by less than {WORTH:.0%}."
    ]
    if wanted_u is not None:
        reached = curve.reaches(wanted_u)
        lines.append(
            f"A largest U of {wanted_u:g} mm is not reached with {last} poses."
            if reached is None
            else f"A largest U of {wanted_u:g} mm takes {wording.counted(reached, 'pose')}."
        )
    lines.append(
        'For a diagnosis let the campaign draw both sides of approach (select = "observability", sides = "both")'
        " and repeat a reference pose (reference_every)."
    )
    return "\n".join(lines)
