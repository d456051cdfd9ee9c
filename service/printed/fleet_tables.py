"""Terminal tables of the diagnosis of many data sets, and its progress."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import RenderableType

from fleet.diagnose import ProgressCounts
from service import wording
from service.printed.tables import grid
from service.printed.terminal import Terminal, duration
from service.results.fleet_diagnosed import (
    FleetDiagnosed,
    FleetRunResult,
    VersionComparisonResponse,
    VersionDifferenceResponse,
)

LINES = 20  # of progress in a log
SHOWN = 20  # rows of a list; the JSON has all


class FleetProgress:
    """Progress of a call, with its processor time, for the terminal."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._step = -1

    def __call__(self, tally: ProgressCounts) -> None:
        step = (tally.total - tally.left) * LINES // max(tally.total, 1)
        if self._terminal.live or step != self._step:
            self._step = step
            self._terminal.say(line(tally))


def line(tally: ProgressCounts) -> str:
    """Format the progress in one line: data sets, processor time of one, workers, time left."""
    parts = [f"{tally.total - tally.left:,} of {tally.total:,} data sets"]
    if tally.seconds_each is not None:
        parts.append(f"{tally.seconds_each:.2f} s of processor time each")
    parts.append(wording.counted(tally.workers, "worker"))
    if tally.seconds_left is not None:
        parts.append(f"{duration(tally.seconds_left)} left")
    return ", ".join(parts)


def shown(result: FleetRunResult, found: FleetDiagnosed) -> Iterable[RenderableType]:
    """Show verdicts with their errors, refusals, failures, changes since another version, and the processor time."""
    table = grid(
        f"{wording.counted(len(found.tables), 'data set')}, TruePose {result.program}",
        "verdict",
        "data sets",
        "held out before, mm",
        "after, mm",
    )
    for verdict, count, before, after in found.verdicts:
        table.add_row(wording.VERDICT_NAMES.get(verdict, verdict), f"{count:,}", _mm(before), _mm(after))
    table.caption = "Medians of the RMS error on held-out readings: base model, and with the effects found."
    yield table
    yield from _listed("Cannot be used", [f"{each.name}: {each.what} {each.do}" for each in result.refused])
    yield from _listed("Without a result", [f"{each.name}: {each.why}" for each in result.failed])
    if result.changes is not None:
        yield from changed(result.changes)
    yield _price(found.tally)


def changed(found: VersionComparisonResponse) -> Iterable[RenderableType]:
    """Show the differences from the results of another version."""
    same = found.compared - len(found.changed)
    versions = ", ".join(found.since) or "no other version"
    median = found.median_ratio_of_held_out_errors
    ratio = "" if median is None else f"; held-out errors now over before: median {median:.3f}"
    missing = f"; {found.missing} have no earlier result" if found.missing else ""
    counts = f"{len(found.changed)} of {found.compared} data sets differ, {same} do not"
    title = f"Since {versions}: {counts}{ratio}{missing}"
    if not found.changed:
        yield f"{title}."
        return
    table = grid(title, "data set", "verdict", "effects", "held out, mm", left=3)
    for each in found.changed[:SHOWN]:
        table.add_row(each.name, _from_to(each.was.verdict, each.now.verdict), _effects(each), _errors(each))
    if len(found.changed) > SHOWN:
        table.caption = f"{len(found.changed) - SHOWN} more in the JSON."
    yield table


def _from_to(was: str, now: str) -> str:
    return now if was == now else f"{was} -> {now}"


def _effects(change: VersionDifferenceResponse) -> str:
    parts = [f"+ {label}" for label in change.new] + [f"- {label}" for label in change.gone]
    was, now = ({each.label: each for each in side.effects} for side in (change.was, change.now))
    for label in change.resized:
        parts.append(f"{label} {was[label].value:.3g} -> {now[label].value:.3g} {now[label].unit}")
    return "\n".join(parts) or "the same"


def _errors(change: VersionDifferenceResponse) -> str:
    return f"{_mm(change.was.rms)} -> {_mm(change.now.rms)}"


def _mm(value: float | None) -> str:
    return "-" if value is None else wording.millimetres(value)


def _listed(title: str, lines: list[str]) -> Iterable[RenderableType]:
    if lines:
        yield f"{title}: {len(lines)}"
        yield from (f"  {each}" for each in lines[:SHOWN])
        if len(lines) > SHOWN:
            yield f"  {len(lines) - SHOWN} more in the JSON"


def _price(tally: ProgressCounts) -> str:
    parts = [f"{tally.done:,} diagnosed now"]
    if tally.known:
        parts.append(f"{tally.known:,} had a result")
    if tally.found:
        parts.append(f"{tally.found:,} were done meanwhile")
    if tally.seconds_each is not None:
        parts.append(
            f"{tally.seconds_each:.2f} s of processor time each, {duration(tally.elapsed)} in all, "
            f"this command {tally.overhead_s:.1f} s of processor time on top (its own scheduler included), "
            f"{tally.start_s:.1f} s to start"
        )
    if tally.lost:
        parts.append(f"{wording.counted(tally.lost, 'worker')} lost")
    return f"{', '.join(parts)}."
