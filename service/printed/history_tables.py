"""Terminal tables of the history of robots."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from fleet.store import AddResult, Document, RobotKey, RobotSummary
from service import wording
from service.printed.tables import grid
from service.results.history import HistoryLine, NextCheck, Trend

SHORT = 12  # letters of a hash that people read
_STATES = {"new": "kept", "known": "known already", "conflict": "kept; contradicts"}


def added(place: str, read: Sequence[tuple[Path, Document]], found: Sequence[AddResult]) -> Table:
    """Show the result of adding documents."""
    shown = grid(f"In {place}", "file", "kind", "robot", "measured", "document", "", left=6)
    for (file, document), its in zip(read, found, strict=True):
        others = "".join(f" {other[:SHORT]}" for other in its.other_hashes)
        state = _STATES[its.state] + (others if its.state == "conflict" else "")
        day = f"{document.measured_at:%Y-%m-%d %H:%M}"
        shown.add_row(file.name, document.kind, _name(document.robot), day, its.hash[:SHORT], state)
    return shown


def robots(found: Sequence[RobotSummary]) -> Table:
    """Show the robots with the number of documents of each."""
    title = wording.counted(len(found), "robot")
    shown = grid(title, "serial number", "type", "cells", "last measured", "documents", left=5)
    for each in found:
        kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(each.documents.items()))
        cells, last = ", ".join(each.cells), f"{each.last:%Y-%m-%d}{' (retired)' if each.retired else ''}"
        shown.add_row(each.robot.serial, each.robot.model, cells, last, kinds)
    return shown


def lines(robot: RobotKey, found: Sequence[HistoryLine]) -> Table:
    """Show all documents of one robot, oldest first."""
    shown = grid(f"Robot {_name(robot)}", "measured", "kind", "what it says", "program", "document", left=5)
    for line in found:
        mark = " (contradicts another)" if line.entry.conflict else ""
        at = f"{line.entry.measured_at:%Y-%m-%d %H:%M}"
        shown.add_row(at, line.entry.kind, line.in_words, line.entry.program, line.entry.hash[:SHORT] + mark)
    return shown


def overview(trends: Sequence[Trend]) -> Table:
    """Show each parameter of one robot in a line."""
    title = f"Robot {_name(trends[0].robot)}"
    shown = grid(title, "parameter", "values", "first", "last", "U", "unit", "signals")
    for trend in trends:
        first, last = trend.points[0], trend.points[-1]
        value, u = _figures(last.value, last.u)
        signals = "-" if trend.chart is None else str(len(trend.signals))
        count = str(len(trend.points))
        shown.add_row(
            trend.parameter, count, _figures(first.value, first.u)[0], value, u, trend.unit, signals
        )
    return shown


def values(trend: Trend) -> Table:
    """Show the values of one parameter with the limits of their chart."""
    title = f"{trend.parameter} of robot {_name(trend.robot)}, {trend.unit}"
    shown = grid(title, "measured", "value", "U", "limits", "", "document")
    for point in trend.shown().values:
        limits = " to ".join(_figures(x, point.u)[0] for x in point.limits or ()) or "-"
        marks = ["signal"] if point.signal else []
        marks += [f"re-diagnosed by {point.program}"] if point.rediagnosed else []
        value, u = _figures(point.value, point.u)
        shown.add_row(point.measured[:10], value, u, limits, ", ".join(marks), point.document[:SHORT])
    return shown


def due(found: Sequence[NextCheck], permitted: float) -> Table:
    """Show the date of the next check of each robot."""
    title = f"{wording.counted(len(found), 'robot')}, {permitted:g} mm permitted"
    shown = grid(
        title, "serial number", "type", "last verdict", "error, mm", "U", "next check", "because", left=3
    )
    for column in shown.columns[-2:]:
        column.justify = "left"
    for each in found:
        value, u = ("-", "-") if each.error is None else _figures(each.error.value, each.error.u)
        date = "-" if each.due is None else f"{each.due.date:%Y-%m-%d}"
        verdict = "-" if each.said is None else each.said.verdict
        robot = each.known.robot
        shown.add_row(robot.serial, robot.model, verdict, value, u, date, each.because)
    return shown


def _name(robot: RobotKey) -> str:
    return f"{robot.serial} ({robot.model})"


def _figures(value: float, u: float | None) -> tuple[str, str]:
    return (f"{value:.4g}", "-") if u is None else wording.with_uncertainty(value, u)
