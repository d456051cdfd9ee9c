"""The output of `validate` on a terminal: one table a question, models side by side."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from calib.data import Dataset
from calib.validation import VISITS_OF_THE_STANDARD, Difference, HoldOutErrors, Judgement, Repeats, Summary
from service import wording
from service.printed.tables import grid
from service.results.judgement.validation_document import MRAD

_FIGURES = ("n", "mean", "std", "mean + 3 s", "RMS", "95 %", "max")
_SHOWN = 12  # repeated poses on a terminal; the JSON holds all
_WHAT_IT_SAYS = {
    "random": "neighbours of every reading are in the fit: flatters",
    "region": "slabs of the workspace that the fit did not see",
    "time": "fifths of every series in the order of measuring",
    "series": "the others' robot, placed on every second reading",
}


def judged(judgements: Sequence[Judgement], holdout: str | None) -> Iterator[RenderableType]:
    """Positions, lengths, turns, pairs and groups of every model. holdout: its kind; None: judged on all rows."""
    for title, found in (
        ("Position error, mm", [(j.name, j.position) for j in judgements]),
        ("Error of the measured distances, mm", [(j.name, j.length) for j in judgements]),
    ):
        table = grid(title, "model", *_FIGURES)
        for name, summary in found:
            if summary is not None:
                table.add_row(name, *_cells(summary))
        if table.row_count:
            yield table
    if any(j.spheres for j in judgements):
        yield _spheres(judgements)
    how = "all measured rows" if holdout is None else f"validation rows; {wording.holdout_in_words(holdout)}"
    yield Text(f"Judged on {how}.", "dim")
    turned = [(j.name, j.orientation) for j in judgements if j.orientation is not None]
    if turned:
        table = grid("Orientation error, mrad", "model", *_FIGURES)
        for name, orientation in turned:
            table.add_row(name, *_cells(orientation, MRAD))
        yield table
    several = any(len(j.pairs) > 1 for j in judgements)
    pairs = [(j.name, series, found) for j in judgements for series, found in j.pairs.items()]
    if pairs:
        table = grid("Distance error over all pairs of points, mm", "model", *_FIGURES)
        for name, series, found in pairs:
            table.add_row(f"{name}, series {series}" if several else name, *_cells(found))
        yield table
    if judgements[0].groupings:
        yield _groups(judgements)


def _spheres(judgements: Sequence[Judgement]) -> Table:
    table = grid(
        "Sphere test: radial error, measured less predicted, mm",
        "model",
        "sphere",
        "n",
        "mean",
        "std",
        "max",
        left=2,
    )
    for judgement in judgements:
        for test in judgement.spheres:
            sphere = f"{test.target} about {test.base_target}, {test.radius_mm:.0f} mm"
            figures = (wording.millimetres(x) for x in (test.std_mm, test.largest_mm))
            table.add_row(judgement.name, sphere, str(len(test.errors_mm)), f"{test.mean_mm:+.4f}", *figures)
    return table


def _groups(judgements: Sequence[Judgement]) -> Table:
    names = ["nominal", *(j.name for j in judgements[1:])]
    heads = [f"{name}: {what}" for name in names for what in ("mean", "max")]
    what = "length" if judgements[0].position is None else "position"
    table = grid(f"Where the {what} error lives, mm", "by", "group", "n", *heads, left=2)
    for groupings in zip(*(j.groupings for j in judgements), strict=True):
        for k, (name, first) in enumerate(groupings[0].groups):
            figures = [x for g in groupings for x in (g.groups[k][1].mean, g.groups[k][1].max)]
            title = groupings[0].title if k == 0 else ""
            table.add_row(title, name, str(first.n), *(wording.millimetres(x) for x in figures))
    return table


def repeated(dataset: Dataset, repeats: Repeats, model: str) -> Iterator[RenderableType]:
    """ISO 9283 figures, commands by the model of this name; nothing at all where no pose was visited twice."""
    if repeats.lengths is not None:
        found = repeats.lengths
        yield Text(
            f"{wording.counted(found.poses, 'distance')} measured more than once ({found.readings} readings): standard "
            f"deviation {found.std_mm:.4f} mm, of the worst {found.worst_mm:.4f} mm."
        )
    if not repeats.poses:
        return
    table = grid("ISO 9283, poses visited repeatedly, mm and mrad", *("pose of reading", "visits"), left=1)
    angled = any(pose.accuracy_angles is not None for pose in repeats.poses)
    for name in ("AP", "RP", "vAP", *(("AP x y z, mrad", "RP x y z, mrad") if angled else ())):
        table.add_column(name, justify="right")
    for pose in repeats.poses[:_SHOWN]:
        cells = [_length(pose.accuracy), _length(pose.repeatability), _length(pose.variation)]
        if angled:
            cells += [_angles(pose.accuracy_angles), _angles(pose.repeatability_angles)]
        table.add_row(dataset.reading_id[pose.reading], str(pose.visits), *cells)
    yield table
    if len(repeats.poses) > _SHOWN:
        yield Text(f"… and {len(repeats.poses) - _SHOWN} poses more; --json lists all.", "dim")
    if repeats.distances:
        accuracy = max(pair.accuracy for pair in repeats.distances)
        spreads = [p.repeatability for p in repeats.distances if math.isfinite(p.repeatability)]
        many = wording.counted(len(repeats.distances), "distance")
        yield Text(
            f"{many} between these poses: AD at most {wording.millimetres(accuracy)} mm"
            + (f", RD at most {wording.millimetres(max(spreads))} mm." if spreads else ".")
        )
    fewest = min(pose.visits for pose in repeats.poses)
    yield Text(
        f"AP and AD count from where {model} expects the target; visits that entered a fit are among them. "
        f"The standard asks for {VISITS_OF_THE_STANDARD} visits of five poses; the least here is {fewest}.",
        "dim",
    )


def held_out(found: Sequence[HoldOutErrors]) -> Iterator[RenderableType]:
    """Hold-outs side by side."""
    table = grid("Error of the base model by kind of hold-out, mm", "held out", *_FIGURES, "")
    table.columns[-1].justify = "left"
    for each in found:
        cells = [""] * len(_FIGURES) if each.errors is None else _cells(each.errors)
        table.add_row(each.kind, *cells, _WHAT_IT_SAYS[each.kind])
    yield table
    lost = [f"{each.left_out} by {each.kind}" for each in found if each.left_out]
    if lost:
        yield Text(
            f"Not judged, since their series or unknown tool target was out of the fit: {', '.join(lost)}.",
            "yellow",
        )


def compared(
    names: tuple[str, str], parameters: Sequence[Difference], apart: Summary | None
) -> Iterator[RenderableType]:
    """Parameters of two calibrations side by side, and how far their predictions are apart."""
    table = grid(
        "Parameters of the robot, changes from nominal",
        *("parameter", names[0], "std. error", names[1], "std. error", "difference", "E_n", "unit"),
    )
    for p in parameters:
        one, other = _with_error(p.first, p.u_first), _with_error(p.second, p.u_second)
        difference = "" if p.difference is None else f"{p.difference:+.3g}"
        e_n = "" if p.e_n is None else f"{p.e_n:.2f}" + (" !" if p.e_n > 1.0 else "")
        table.add_row(p.name, *one, *other, difference, e_n, p.unit)
    table.columns[-1].justify = "left"
    yield table
    judged_ = [p for p in parameters if p.e_n is not None]
    above = [p.name for p in judged_ if p.e_n is not None and p.e_n > 1.0]
    yield Text(
        f"E_n above 1 (!) in {len(above)} of {len(judged_)}: {', '.join(above)}."
        if above
        else f"E_n is 1 or less in all {len(judged_)}.",
        "yellow" if above else "",
    )
    if apart is not None:
        table = grid("Distance between the two predictions, mm", "", *_FIGURES)
        table.add_row("both placed on the same rows", *_cells(apart))
        yield table


def _cells(summary: Summary, factor: float = 1.0) -> list[str]:
    figures = (summary.mean, summary.std, summary.mean_3std, summary.rms, summary.p95, summary.max)
    return [str(summary.n), *(_length(factor * x) for x in figures)]


def _length(value: float | None) -> str:
    return "" if value is None or not math.isfinite(value) else wording.millimetres(value)


def _angles(angles: tuple[float, ...] | None) -> str:
    return "" if angles is None else " ".join(f"{MRAD * angle:.3f}" for angle in angles)


def _with_error(value: float | None, error: float | None) -> tuple[str, str]:
    return ("", "") if value is None or error is None else wording.with_uncertainty(value, error)
