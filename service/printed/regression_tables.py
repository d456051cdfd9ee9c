"""Terminal output of `regress`: table of errors, and findings."""

from __future__ import annotations

from collections.abc import Iterator

from rich import box
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from service.results.models.regressed import RegressionResult

_NO_DECIMALS = 1000.0  # um
COLUMNS = ("MAE x", "y", "z", "mean", "RMSE x", "y", "z", "mean")


def rows(result: RegressionResult) -> Iterator[tuple[str, str, list[str]]]:
    """Yield name, "in sample" or "by waypoint", and eight errors in um for each predictor."""
    for row in result.table_um:
        for kind, errors in (("in sample", row.in_sample), ("by waypoint", row.by_waypoint)):
            yield row.name, kind, [_um(value) for _, value in (*errors.mae, *errors.rmse)]


def _um(value: float) -> str:
    return f"{value:.1f}" if value < _NO_DECIMALS else f"{value:,.0f}"


def shown(result: RegressionResult) -> Iterator[RenderableType]:
    """Show the table and the sentences below it."""
    table = Table(
        title=f"Error of {result.samples} samples at {result.waypoints} waypoints, um",
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    for i, name in enumerate(("", "judged", *COLUMNS)):
        table.add_column(name, justify="left" if i < 2 else "right", overflow="fold")
    last = ""
    for name, kind, figures in rows(result):
        table.add_row(
            "" if name == last else name, kind, *figures, style="" if kind == "by waypoint" else "dim"
        )
        last = name
    yield table
    yield Text(
        "By waypoint: whole waypoints left out in five parts, everything fitted and chosen again with the rest.",
        "dim",
    )
    for finding in result.findings:
        yield Text(finding)
