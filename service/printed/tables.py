"""Terminal tables of results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from calib.diagnose import SEPARATES, CarryOver, DiagnosisFit, FollowUp
from calib.fit import ErrorStatistics, ExcludedReading, IdentificationFit
from calib.fit import left_out as rows_left_out
from calib.units import percent
from service import wording
from service.results.common import ParameterResponse
from service.results.judgement.acceptance import NAMES, RULE, AcceptanceResult
from service.results.models import positions
from service.results.models.diagnosed import PatchResult
from service.results.models.parameters import rows_of
from service.results.shape import ResponseBody, cells_of, columns_of

_SHOWN = 24  # effects listed on a terminal; the report and the JSON hold all
_LEFT_OUT = 20  # readings left out that are listed on a terminal
_CHECKS = 6  # effects for which the terminal lists a check


def grid(title: str, *columns: str, left: int = 1) -> Table:
    """Create a table whose first `left` columns hold text and whose others hold numbers."""
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for i, name in enumerate(columns):
        table.add_column(name, justify="left" if i < left else "right", overflow="fold")
    return table


def table_of(
    kind: type[ResponseBody], title: str, heads: tuple[str, ...], rows: Iterable[tuple[Any, ...]]
) -> Table:
    """Create a table of results. Each row has the labels that `heads` names, then the result."""
    table = grid(title, *heads, *(column.head for column in columns_of(kind).values()), left=len(heads))
    for *labels, result in rows:
        table.add_row(*labels, *cells_of(result))
    return table


def diagnosis(
    result: DiagnosisFit, carried: CarryOver | None, patched: PatchResult | None
) -> Iterable[RenderableType]:
    """Show a diagnosis: verdict, effects, checks, next measurements, errors and warnings."""
    yield Text.assemble(
        (f"{wording.VERDICT_NAMES[result.verdict]}. ", "bold"), wording.verdict_in_words(result)
    )
    yield effects(result)
    yield checks(result)
    yield numbered("Carried without a cause", wording.stated_carried(result.carried))
    yield numbered("What to measure next", result.next_measurements)
    if result.follow_up is not None:
        yield follow_up(result.follow_up)
    yield errors(
        {
            "nominal robot, placed": result.error_nominal,
            "identified base model": result.error_before,
            **({"with the effects found": result.error_named} if result.effects else {}),
            **({"with carried terms": result.error_after} if result.carried else {}),
        },
        result.dataset.header.holdout,
        wording.error_kind(result.dataset),
    )
    yield offsets(result.final)
    if carried is not None:
        yield errors(
            {
                "its own base model": carried.base,
                "effects frozen as found": carried.frozen,
                "amplitudes fitted anew": carried.refitted,
            },
            f"carried over to {carried.name}, another series",
        )
        yield Text(carried.finding)
    if patched is not None:
        yield patch(patched)
    yield left_out(rows_left_out(result.dataset, result.final))
    yield warnings(
        [
            *(wording.structure_in_words(s) for s in result.structure[:4]),
            *wording.grouped(result.final.warnings, most=6),
            *result.notes,
        ]
    )


def effects(result: DiagnosisFit) -> RenderableType:
    """Show the confirmed effects with amplitude, uncertainty and share, strongest first.

    Many effects are ordered by group. If the causes are not known, no rivals are listed, because the unknown law itself
    is a rival of all effects.
    """
    found, known = result.confirmed, result.causes_known
    if not result.effects:
        return Text("")
    last = ("rivals",) if known else ()
    title = "Effects found" if known else "Imitated by (the law that is left may resemble these effects)"
    table = grid(title, "effect", "amplitude ± U (k = 2)", "unit", "usual size", "explains", *last)
    for text in (2, *((5,) if known else ())):
        table.columns[text].justify = "left"
    for group, members in wording.by_group(found[:_SHOWN]):
        if group:
            table.add_section()
            table.add_row(Text(group, "dim"))
        for effect in members:
            value, uncertainty, unit = wording.amplitude(effect)
            rivals = (
                ", ".join(f"{label} {percent(w)}" for label, w in wording.rivals_of(effect)[:3]) or "none"
            )
            shape = wording.shape_of(effect)
            table.add_row(
                effect.effect.label + (f" ({shape})" if shape else ""),
                f"{value} ± {uncertainty}",
                unit,
                wording.usual_size(effect),
                f"{effect.evidence.explained_variance:.1%}",
                *((rivals,) if known else ()),
            )
    below: list[RenderableType] = [
        Text(f"{each.effect.label}: {wording.IMPOSSIBLE}") for each in found if each.impossible
    ]
    if len(found) > _SHOWN:
        below.append(Text(f"… and {len(found) - _SHOWN} weaker ones; --json and --report list all.", "dim"))
    if left := wording.unconfirmed(result.effects):
        below.append(Text(left, "dim"))
    return Group(*((table,) if found else ()), *below)


def checks(result: DiagnosisFit) -> RenderableType:
    """Show the checks of a technician for the strongest effects; nothing if there are none."""
    known = result.causes_known
    rows = [(f.effect.label, wording.advice_on(f, causes_known=known)) for f in result.effects]
    rows = [row for row in rows if row[1]][:_CHECKS]
    if not rows:
        return Text("")
    table = grid("What to check", "effect", "check", left=2)
    for row in rows:
        table.add_row(*row)
    return table


def follow_up(planned: FollowUp) -> RenderableType:
    """Show how well the follow-up poses separate each pair of rivals.

    Procedures for questions that no pose can settle follow.
    """
    title = f"What {wording.counted(len(planned.joints), 'follow-up pose')} would distinguish"
    table = grid(title, "effect", "from its rival", "expected squared distance", left=2)
    for (label, rival), square in planned.separations.items():
        table.add_row(label, rival, f"{square:.0f}")
    settles = Text(f"In units of the noise; {SEPARATES:g} settles a pair.", "dim")
    return Group(table, settles, *(Text(advice) for advice in planned.procedures))


def left_out(rows: Sequence[ExcludedReading]) -> RenderableType:
    """Show the readings that the fit left out, worst first, with their poses; nothing if none."""
    if not rows:
        return Text("")
    table = grid(
        f"Readings left out ({len(rows)})",
        "reading",
        "target",
        "joints, deg",
        "error, mm",
        "times the noise",
        left=3,
    )
    for row in rows[:_LEFT_OUT]:
        joints = " ".join(f"{angle:.1f}" for angle in row.joints_deg)
        table.add_row(
            row.reading_id, row.target, joints, wording.millimetres(row.error_mm), f"{row.times_noise:.0f}"
        )
    if len(rows) <= _LEFT_OUT:
        return table
    return Group(table, Text(f"… and {len(rows) - _LEFT_OUT} more; --json and --report list all.", "dim"))


def patch(patched: PatchResult) -> RenderableType:
    """Show the gain of a smooth map of the residual, separate from all named causes."""
    table = errors({"without the patch": patched.without, "with the patch": patched.with_it}, "as above")
    return Group(Text("Patch", "bold"), Text(wording.patch_in_words(patched.patch)), table)


def errors(
    rows: Mapping[str, ErrorStatistics | None], holdout: str, kind: str = wording.POSITION_ERROR
) -> RenderableType:
    """Show errors on validation rows, and name the kind of hold-out."""
    known = {name: e for name, e in rows.items() if e is not None}
    if not known:
        return Text(
            "No measured validation rows: nothing here was judged on readings that took no part.", "yellow"
        )
    table = grid(f"{kind} on held-out readings, mm", "model", "n", "mean", "RMS", "95 %", "max")
    for name, e in known.items():
        table.add_row(name, str(e.n), *(wording.millimetres(x) for x in (e.mean, e.rms, e.p95, e.max)))
    return Group(table, Text(f"Hold-out: {wording.holdout_in_words(holdout)}.", "dim"))


def acceptance(found: AcceptanceResult | None) -> RenderableType:
    """Show the verdict on the limits with its rule; nothing if no limits were given."""
    if found is None:
        return Text("")
    table = grid(
        f"Acceptance: {NAMES[found.verdict]}", "figure", "value, mm", "U, mm", "limit, mm", "verdict"
    )
    for each in found.criteria:
        table.add_row(each.name, *each.shown, f"{each.limit:g}", NAMES[each.verdict])
    by = "; ".join(f"{each.name}: {each.basis}" for each in found.criteria)
    return Group(table, Text(f"{RULE} U by: {by}.", "dim"))


def parameters(found: IdentificationFit) -> RenderableType:
    """Show each parameter with its change and standard error; dropped ones with the reason."""
    table = grid("Parameters", "parameter", "nominal", "identified", "change", "std. error", "unit")
    table.columns[5].justify = "left"
    for row in rows_of(found):
        table.add_row(*_cells(row))
    return table


def _cells(row: ParameterResponse) -> tuple[str, ...]:
    nominal = "" if row.nominal is None else f"{row.nominal:.4f}"
    if row.absolute is None or row.absolute_std is None:
        with_whom = ", ".join(row.confounded_with[:4])
        reason = f"dropped: confounded with {with_whom}" if with_whom else "dropped: moves nothing here"
        return row.name, nominal, reason, "", "", row.unit
    _, error = wording.with_uncertainty(row.absolute, row.absolute_std)
    places = len(error.partition(".")[2])
    change = "" if row.change_from_nominal is None else f"{row.change_from_nominal:+.{places}f}"
    return row.name, nominal, f"{row.absolute:.{places}f}", change, error, row.unit


def offsets(found: IdentificationFit) -> RenderableType:
    """Compare targets with uncertain positions with their values in the file; nothing if none."""
    rows = positions.rows_of(found)
    if not rows:
        return Text("")
    table = grid("Positions known to an uncertainty", *positions.HEADINGS)
    for row in rows:
        table.add_row(*row)
    return table


def numbered(title: str, texts: Sequence[str]) -> RenderableType:
    """Show numbered sentences; nothing if there are none."""
    if not texts:
        return Text("")
    table = grid(title, "", "", left=2)
    table.show_header = False
    for number, text in enumerate(texts, start=1):
        table.add_row(f"[{number}]", text)
    return table


def warnings(texts: Sequence[str]) -> RenderableType:
    """Show numbered warnings and notes."""
    return numbered("Warnings and notes", texts)


def revealed(hidden: Sequence[Mapping[str, Any]], result: DiagnosisFit) -> RenderableType:
    """Compare the effects that the simulation had hidden with those found."""
    labels = {str(effect["label"]) for effect in hidden}
    classes = {name for found in result.effects for name in found.evidence.candidates}
    lines: list[RenderableType] = [Text("Now revealed: what the simulation had hidden", "bold")]
    for effect in hidden:
        sizes = ", ".join(
            f"{name} {p['value']:.4g} {p['unit']}".strip() for name, p in effect["parameters"].items()
        )
        named = any(found.effect.label == effect["label"] for found in result.effects)
        mark = "found" if named else "among the rivals" if effect["label"] in classes else "missed"
        lines.append(Text(f"  {effect['label']}: {sizes}. {mark}.", "green" if named else "yellow"))
    if not hidden:
        lines.append(Text("  nothing"))
    for found in result.effects:
        if found.effect.label not in labels and not labels & set(found.evidence.candidates):
            lines.append(Text(f"  {found.effect.label} was claimed although nobody hid it.", "yellow"))
    return Padding(Group(*lines), (1, 0))
