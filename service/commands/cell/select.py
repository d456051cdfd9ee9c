"""`truepose select`: choose calibration poses in a cell, and how many are worth measuring."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import RenderableType
from rich.table import Table

from acquisition import read_cell
from calib.data import DEFAULT_GROUPS
from calib.selection import SHARE, STEP, WORTH, Candidates, Choice, Curve
from calib.text import replace_file
from calib.units import percent
from service import exit_codes, wording
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed import tables
from service.printed.terminal import Terminal
from service.results.cell.selected import Selected, SelectionRequest


def select(
    cell: Annotated[Path, typer.Argument(metavar="CELL.toml", help="Cell file.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="POSES.csv", help='File for the poses, for a block with select = "file".'
        ),
    ],
    count: Annotated[int, typer.Option(min=1, help="Number of poses to select.")] = 50,
    candidates: Annotated[
        int,
        typer.Option(
            "--candidates", "--from", min=1, max=50_000, help="Number of random poses to select from."
        ),
    ] = 5000,
    groups: Annotated[
        str,
        typer.Option(
            metavar="NAMES", help="Parameter groups that the poses must determine, separated by commas."
        ),
    ] = ",".join(DEFAULT_GROUPS),
    targets: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Targets measured at every pose (default: all of the cell)."),
    ] = None,
    offset_deg: Annotated[
        float,
        typer.Option(
            "--approach-deg",
            "--offset-deg",
            min=-30.0,
            max=30.0,
            help="Offset of the approach point from the pose, per joint, deg, negative for an approach from below.",
        ),
    ] = -5.0,
    share: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=1.0,
            help="Largest share of the poses that may serve to cover the joint ranges, 0 to 1.",
        ),
    ] = SHARE,
    wanted_u: Annotated[
        float | None,
        typer.Option(
            "--require-u",
            "--wanted-u",
            min=0.0,
            metavar="MM",
            help="Required U (k = 2) of a position, mm. Exit code 3 if the predicted U is larger.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random candidates and starts.")] = 1,
    prior: options.PriorFile = None,
    json: options.Json = None,
) -> None:
    """Choose calibration poses by observability."""
    options.check_outputs({"--out": out, "--json": json}, inputs=(cell, prior))
    asked = SelectionRequest(
        count=count,
        candidates=candidates,
        groups=_listed(groups),
        targets=None if targets is None else _listed(targets),
        offset_deg=offset_deg,
        share=share,
        wanted_u=wanted_u,
        seed=seed,
        prior=options.read_prior(prior),
    )
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        found = Selected.of(read_cell(cell), asked, terminal.say)
        choice, curve = found.choice, found.curve
        options.write_result(found.document(), json, terminal)
        replace_file(out, found.csv)
        terminal.rest()
        drawn = len(found.candidates.joints)
        for each in (
            _summary(found.candidates, choice),
            _curve(curve, count),
            tables.warnings([*_dropped(choice), *choice.warnings, *_shortage(drawn, candidates)]),
        ):
            terminal.out.print(each)
        if found.of_type is not None:
            terminal.out.print(_curve(found.of_type.curve, count, "with what robots of the type share"))
            terminal.out.print(found.of_type.in_words)
        terminal.out.print(_advice(curve, wanted_u))
        terminal.note(f"poses: {out}")
    if wanted_u is not None and curve.at(count) > wanted_u:
        terminal.note(f"truepose: U of {curve.at(count):.4f} mm is above the {wanted_u:g} mm asked for.")
        raise typer.Exit(exit_codes.NOT_MET)


def _listed(text: str) -> tuple[str, ...]:
    """Parse names with commas between."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


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


def _curve(curve: Curve, count: int, beside: str = "") -> RenderableType:
    table = Table(
        title=" ".join(("Predicted U of the position, k = 2, worst direction, mm", beside)).rstrip(),
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
        f"Beyond {last} poses, {STEP} more still lower the largest U by {percent(WORTH)} or more."
        if enough is None
        else f"From {enough} poses on, {STEP} more lower the largest U by less than {percent(WORTH)}."
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
