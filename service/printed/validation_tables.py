"""Terminal output of `validate`: one table per question, models side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from service import wording
from service.printed.tables import grid, table_of
from service.results.judgement.validation import (
    ComparisonShown,
    HoldOutShown,
    Iso9283,
    JudgementShown,
    SphereShown,
    SummaryShown,
    ValidationResult,
)
from service.results.shape import cells_of, columns_of, length_cell

_SHOWN = 12  # repeated poses on a terminal; the JSON holds all
_WHAT_IT_SAYS = {
    "random": "neighbours of every reading are in the fit: flatters",
    "region": "slabs of the workspace that the fit did not see",
    "time": "fifths of every series in the order of measuring",
    "series": "the others' robot, placed on every second reading",
}


def validation(result: ValidationResult) -> Iterator[RenderableType]:
    """Show a validation, without acceptance and warnings."""
    if result.hold_outs:
        yield from _held_out(result.hold_outs)
        return
    yield from _judged(result.judgements, result.holdout)
    if result.balls is not None:
        which = (
            "calibration rows"
            if result.balls.by == "calibration"
            else "half of the poses, which do not judge"
        )
        yield Text(
            f"{wording.counted(result.balls.distances, 'distance')} ({which}) placed the balls, for every robot alike.",
            "dim",
        )
    if result.length_repeatability is not None:
        found = result.length_repeatability
        yield Text(
            f"{wording.counted(found.poses, 'distance')} measured more than once ({found.readings} readings): standard "
            f"deviation {found.std_mm:.4f} mm, of the worst {found.worst_std_mm:.4f} mm."
        )
    if result.iso9283 is not None and result.iso9283.poses:
        yield from _repeated(result.iso9283, result.judgements[1].model)
    if result.comparison is not None:
        yield from _compared(result.comparison)


def _judged(judgements: Sequence[JudgementShown], holdout: str | None) -> Iterator[RenderableType]:
    """Show position, length, sphere, orientation, pair and group errors of each model.

    `holdout` is the kind of hold-out; None if all measured rows were judged.
    """

    def errors(title: str, found: Iterator[tuple[str, SummaryShown | None]]) -> Iterator[Table]:
        rows = [(name, summary) for name, summary in found if summary is not None]
        if rows:
            yield table_of(SummaryShown, title, ("model",), rows)

    yield from errors("Position error, mm", ((j.model, j.position_mm) for j in judgements))
    yield from errors("Error of the measured distances, mm", ((j.model, j.length_mm) for j in judgements))
    spheres = [
        (j.model, f"{test.tool_target} about {test.base_target}, {test.radius_mm:.0f} mm", test)
        for j in judgements
        for test in j.spheres
    ]
    if spheres:
        title = "Sphere test: radial error, measured less predicted, mm"
        yield table_of(SphereShown, title, ("model", "sphere"), spheres)
    how = "all measured rows" if holdout is None else f"validation rows; {wording.holdout_in_words(holdout)}"
    yield Text(f"Judged on {how}.", "dim")
    yield from errors("Orientation error, mrad", ((j.model, j.orientation_mrad) for j in judgements))
    several = any(len(j.pairs_mm) > 1 for j in judgements)
    yield from errors(
        "Distance error over all pairs of points, mm",
        (
            (f"{j.model}, series {series}" if several else j.model, found)
            for j in judgements
            for series, found in j.pairs_mm.items()
        ),
    )
    if judgements[0].groups:
        yield _groups(judgements)


def _groups(judgements: Sequence[JudgementShown]) -> Table:
    names = ["nominal", *(j.model for j in judgements[1:])]
    heads = [f"{name}: {what}" for name in names for what in ("mean", "max")]
    what = "length" if judgements[0].position_mm is None else "position"
    table = grid(f"Where the {what} error lives, mm", "by", "group", "n", *heads, left=2)
    for parts in zip(*(j.groups for j in judgements), strict=True):
        title, found = parts[0].by, [part.position_mm or part.length_mm for part in parts]
        for name, first in found[0].items():
            figures = [x for group in found if (of := group[name]) for x in (of.mean, of.max)]
            count = "" if first is None else str(first.n)
            table.add_row(title, name, count, *(_length(x) for x in figures))
            title = ""
    return table


def _repeated(iso: Iso9283, model: str) -> Iterator[RenderableType]:
    """Show ISO 9283 results of repeated poses; `model` names the model that gives the targets."""
    table = grid("ISO 9283, poses visited repeatedly, mm and mrad", *("pose of reading", "visits"), left=1)
    angled = any(pose.AP_xyz_mrad is not None for pose in iso.poses)
    for name in ("AP", "RP", "vAP", *(("AP x y z, mrad", "RP x y z, mrad") if angled else ())):
        table.add_column(name, justify="right")
    for pose in iso.poses[:_SHOWN]:
        cells = [_length(pose.AP_p_mm), _length(pose.RP_l_mm), _length(pose.vAP_p_mm)]
        if angled:
            cells += [_angles(pose.AP_xyz_mrad), _angles(pose.RP_xyz_mrad)]
        table.add_row(str(pose.first_reading), str(pose.visits), *cells)
    yield table
    if len(iso.poses) > _SHOWN:
        yield Text(f"… and {len(iso.poses) - _SHOWN} poses more; --json lists all.", "dim")
    if iso.distances:
        accuracies = [pair.AD_p_mm for pair in iso.distances if pair.AD_p_mm is not None]
        spreads = [pair.RD_mm for pair in iso.distances if pair.RD_mm is not None]
        many = wording.counted(len(iso.distances), "distance")
        yield Text(
            f"{many} between these poses: AD at most {wording.millimetres(max(accuracies))} mm"
            + (f", RD at most {wording.millimetres(max(spreads))} mm." if spreads else ".")
        )
    fewest = min(pose.visits for pose in iso.poses)
    yield Text(
        f"AP and AD count from where {model} expects the target; visits that entered a fit are among them. "
        f"The standard asks for {iso.visits_of_the_standard} visits of five poses; the least here is {fewest}.",
        "dim",
    )


def _held_out(found: Sequence[HoldOutShown]) -> Iterator[RenderableType]:
    """Show the hold-outs side by side."""
    table = table_of(SummaryShown, "Error of the base model by kind of hold-out, mm", ("held out",), ())
    table.add_column("")
    for each in found:
        none = [""] * len(columns_of(SummaryShown))
        cells = none if each.error_mm is None else cells_of(each.error_mm)
        table.add_row(each.kind, *cells, _WHAT_IT_SAYS[each.kind])
    yield table
    lost = [f"{each.left_out} by {each.kind}" for each in found if each.left_out]
    if lost:
        yield Text(
            f"Not judged, since their series or unknown tool target was out of the fit: {', '.join(lost)}.",
            "yellow",
        )


def _compared(found: ComparisonShown) -> Iterator[RenderableType]:
    """Compare the parameters of two calibrations, and show the distance of their predictions."""
    first, second = found.models[:2]
    table = grid(
        "Parameters of the robot, changes from nominal",
        *("parameter", first, "std. error", second, "std. error", "difference", "E_n", "unit"),
    )
    for p in found.parameters:
        one, other = _with_error(p.first, p.u_first), _with_error(p.second, p.u_second)
        difference = "" if p.difference is None else f"{p.difference:+.3g}"
        e_n = "" if p.e_n is None else f"{p.e_n:.2f}" + (" !" if p.e_n > 1.0 else "")
        table.add_row(p.name, *one, *other, difference, e_n, p.unit)
    table.columns[-1].justify = "left"
    yield table
    ratios = {p.name: p.e_n for p in found.parameters if p.e_n is not None}
    above = [name for name, e_n in ratios.items() if e_n > 1.0]
    yield Text(
        f"E_n above 1 (!) in {len(above)} of {len(ratios)}: {', '.join(above)}."
        if above
        else f"E_n is 1 or less in all {len(ratios)}.",
        "yellow" if above else "",
    )
    if found.prediction_difference_mm is not None:
        rows = [("both placed on the same rows", found.prediction_difference_mm)]
        yield table_of(SummaryShown, "Distance between the two predictions, mm", ("",), rows)


def _length(value: float | None) -> str:
    return "" if value is None else length_cell(value)


def _angles(angles: Sequence[float | None] | None) -> str:
    return "" if angles is None else " ".join("" if angle is None else f"{angle:.3f}" for angle in angles)


def _with_error(value: float | None, error: float | None) -> tuple[str, str]:
    return ("", "") if value is None or error is None else wording.with_uncertainty(value, error)
