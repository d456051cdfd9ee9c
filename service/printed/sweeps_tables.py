"""Terminal tables of the sweeps of single joints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import RenderableType

from calib.units import DEG
from service import wording
from service.printed.tables import grid, table_of, warnings
from service.results.models.swept import SweepResponse, SweepsResult

LEVER_MM = 1000.0  # lever arm at which the error of a joint is also shown as a length


def tables(result: SweepsResult) -> Iterable[RenderableType]:
    """Show error range, reversal and deviation from the circle of each joint, and compare its axis."""
    shown = grid(
        "Joints one at a time",
        "joint",
        "target",
        "n",
        "from, deg",
        "to, deg",
        "radius, mm",
        "error range, deg",
        f"at {LEVER_MM:.0f} mm, mm",
        "reversal, deg",
        "k = 2",
        left=2,
    )
    for sweep in result.sweeps:
        shown.add_row(
            str(sweep.joint),
            sweep.target,
            str(sweep.readings),
            f"{sweep.from_deg:.1f}",
            f"{sweep.to_deg:.1f}",
            f"{sweep.radius_mm:.1f}",
            f"{sweep.error_range_deg:.4f}",
            wording.millimetres(sweep.error_range_deg * DEG * LEVER_MM),
            *_reversal(sweep),
        )
    shown.caption = (
        "Reversal: what readings on the way up show more than those on the way down; above zero the joint rests beyond "
        "its target (backlash), below zero it stops short (lost motion). A '-' was measured in one direction only."
    )
    shown.caption_justify = "left"
    yield shown
    off = table_of(
        SweepResponse,
        "Deviation from the circle, mm",
        ("joint", "target"),
        [(str(sweep.joint), sweep.target, sweep) for sweep in result.sweeps],
    )
    off.caption = (
        "Along the radius: the joint runs out of round. Along the axis: it wobbles. Gravity that turns with the joint, "
        "and noise, show in both."
    )
    off.caption_justify = "left"
    yield off
    if any(sweep.axis is not None for sweep in result.sweeps):
        yield _axes(result.sweeps)
    yield warnings(result.warnings)


def _reversal(sweep: SweepResponse) -> tuple[str, str]:
    if sweep.reversal_deg is None:
        return "-", "-"
    u = "-" if sweep.u_reversal_deg is None else f"{2.0 * sweep.u_reversal_deg:.4f}"
    return f"{sweep.reversal_deg:+.4f}", u


def _axes(sweeps: Sequence[SweepResponse]) -> RenderableType:
    shown = grid(
        "Axes of the circles beside those of the identified arm",
        "joint",
        "target",
        "between directions, deg",
        "k = 2",
        "from centre to axis, mm",
        "k = 2",
        left=2,
    )
    for sweep in sweeps:
        if (axis := sweep.axis) is not None:
            shown.add_row(
                str(sweep.joint),
                sweep.target,
                f"{axis.angle_deg:.4f}",
                f"{2.0 * axis.u_angle_deg:.4f}",
                wording.millimetres(axis.distance_mm),
                wording.millimetres(2.0 * axis.u_distance_mm),
            )
    shown.caption = (
        "k = 2: what the scatter about the circle leaves open. More than that is what bends the circle: gravity that "
        "turns with the joint, and the joint's own error over a part of a turn."
    )
    shown.caption_justify = "left"
    return shown
