"""Terminal tables of the plan and the verdict of a watch."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import RenderableType

from calib.units import percent
from calib.watch import ALONE, SEEN, WatchPlanProposal
from service import wording
from service.printed import tables
from service.results.watch_answers import QuestionShown, ThermalShown, UpkeepResult, WatchCause, WatchResult
from service.results.watch_plan import PlannedWatch

_PROPOSALS = 4


def plan_tables(found: PlannedWatch) -> list[RenderableType]:
    """Show the sizes of causes that the check poses detect, and proposals to detect more."""
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


def verdict_tables(found: WatchResult) -> list[RenderableType]:
    """The verdict, the questions that were asked of the readings, and the causes."""
    rows = [
        (
            "this watch" if each.watches == 1 else f"mean over {each.watches} watches",
            f"{each.t_squared:.1f} of {each.values} values",
            each,
        )
        for each in found.questions
    ]
    title = f"The readings against {found.model}, at {_alarms(found.false_alarms)}"
    table = tables.table_of(QuestionShown, title, ("", "T-squared"), rows)
    table.columns[1].justify = "right"
    shown: list[RenderableType] = [found.in_words, f"What to do: {found.advice}", table]
    if found.causes:
        title = "Causes" if found.verdict != "unexplained" else "What comes nearest, and does not explain it"
        shown.append(tables.table_of(WatchCause, title, ("cause",), [(c.label, c) for c in found.causes]))
    return [*shown, tables.warnings(found.notes)]


def upkeep_tables(found: UpkeepResult) -> list[RenderableType]:
    """The thermal part of the change, and whether the rest is chance."""
    rows = [(each.name, each) for each in found.parameters]
    return [
        found.in_words,
        f"What to do: {found.advice}",
        f"Beside it T-squared is {found.t_squared:.1f} of {found.values} values, "
        f"the limit {found.t_squared_limit:.1f}.",
        tables.table_of(ThermalShown, "Thermal parameters", ("parameter",), rows),
        tables.warnings(found.notes),
    ]
