"""The plan and the verdict of a watch as tables of a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import RenderableType

from calib.units import percent
from calib.watch import ALONE, SEEN, WatchPlanProposal
from service import wording
from service.printed import tables
from service.results.upkept import ThermalUpdateSummary
from service.results.watch_plan import PlannedWatch
from service.results.watched import WatchResultSummary

_PROPOSALS = 4


def plan_tables(found: PlannedWatch) -> list[RenderableType]:
    """The sizes of the causes that the check poses detect, and what it would take to detect more."""
    causes = found.plan.shown.causes
    poses = wording.counted(found.asked.poses, "pose")
    rounds = "" if found.plan.rounds == 1 else f", each visited {found.plan.rounds} times"
    repeats = "" if found.plan.repeats == 1 else f", each target read {found.plan.repeats} times in a visit"
    readings = wording.counted(found.plan.shown.readings, "reading")
    shown = tables.grid(
        f"{poses}{rounds}{repeats}: {readings}. Smallest size of each cause at {_alarms(found.asked.rate)}",
        "cause",
        f"detected in {percent(SEEN)}",
        f"identified alone in {percent(ALONE)}",
        "wanted size",
        "detected in",
        "looks the same as",
        left=1,
    )
    for each in causes:
        alone = "never" if each.always else "-" if each.alone is None else f"{each.alone:.3g} {each.unit}"
        wanted = "" if each.wanted is None else f"{each.wanted:g} {each.unit}"
        share = "" if each.share is None else percent(each.share)
        shown.add_row(
            each.label, f"{each.size:.3g} {each.unit}", alone, wanted, share, ", ".join(each.always)
        )
    shown.caption = (
        "tool_shift, base_shift: in the worst direction. -: more than ten times the size detected."
    )
    lines: list[RenderableType] = [shown]
    if found.plan.shown.unseen:
        lines.append(f"These readings cannot show at all: {', '.join(found.plan.shown.unseen)}.")
    if found.nests is not None:
        lines.append(
            f"The nests are measured again half-way. Where they differ by over {found.nests.limit_mm:.3f} mm a person "
            f"is asked. An instrument that moved by {found.nests.seen_mm:.3f} mm is noticed in {percent(SEEN)}."
        )
    if found.proposals:
        lines += _proposals(found.proposals)
    lines.append(found.in_words)
    return lines


def _alarms(rate: float) -> str:
    return f"{100.0 * rate:.2g}\u00a0% false alarms"


def _proposals(proposals: Sequence[WatchPlanProposal]) -> list[RenderableType]:
    table = tables.grid(
        "Fewest readings at these poses that detect the wanted sizes",
        "--targets",
        "--visits",
        "--readings",
        "readings in all",
        "except",
        left=1,
    )
    for each in proposals[:_PROPOSALS]:
        missed = ", ".join(label for label, _ in each.beyond)
        table.add_row(",".join(each.targets), str(each.rounds), str(each.repeats), str(each.readings), missed)
    return [table]


def verdict_tables(found: WatchResultSummary) -> list[RenderableType]:
    """The verdict, the questions that were asked of the readings, and the causes."""
    verdict = found.verdict
    shown: list[RenderableType] = [
        verdict.in_words,
        f"What to do: {verdict.advice}",
    ]
    table = tables.grid(
        f"The readings against {found.model.name}, at {_alarms(verdict.rate)}",
        "",
        "T-squared",
        "limit",
        "smallest p",
        "limit",
        "alarm",
    )
    for each in verdict.questions:
        name = "this watch" if each.watches == 1 else f"mean over {each.watches} watches"
        table.add_row(
            name,
            f"{each.t_squared:.1f} of {each.rows} values",
            f"{each.limit:.1f}",
            wording.chance(each.p_value),
            f"{each.p_limit:.2g}",
            "yes" if each.alarm else "no",
        )
    shown.append(table)
    if verdict.causes:
        title = "Causes" if verdict.kind != "unexplained" else "What comes nearest, and does not explain it"
        causes = tables.grid(title, "cause", "weight", "size")
        for cause, weight in verdict.causes:
            causes.add_row(cause.label, f"{weight:.2f}", str(cause.size))
        shown.append(causes)
    shown.append(tables.warnings(found.notes))
    return shown


def upkeep_tables(found: ThermalUpdateSummary) -> list[RenderableType]:
    """The thermal part of the change, and whether the rest is chance."""
    rest = found.found.rest.questions[0]
    table = tables.grid("Thermal parameters", "parameter", "before", "now", "U (k = 2)", "", left=1)
    for name, before, now, u, unit in found.rows:
        table.add_row(name, f"{before:.4g}", f"{now:.4g}", f"{u:.2g}", unit)
    return [
        found.in_words,
        f"What to do: {found.advice}",
        f"Beside it T-squared is {rest.t_squared:.1f} of {rest.rows} values, the limit {rest.limit:.1f}.",
        table,
        tables.warnings(found.notes),
    ]
