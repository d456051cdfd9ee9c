"""Terminal tables of the sweeps of single joints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import RenderableType

from calib.sweeps import JointSweep
from calib.units import DEG
from service import wording
from service.printed.tables import grid, warnings

LEVER_MM = 1000.0  # lever arm at which the error of a joint is also shown as a length


def tables(sweeps: Sequence[JointSweep], remarks: Sequence[str]) -> Iterable[RenderableType]:
    """Show error range and reversal of each joint, and compare its axis with the identified one."""
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
    for sweep in sweeps:
        low, high = sweep.angle.min() / DEG, sweep.angle.max() / DEG
        shown.add_row(
            str(sweep.joint),
            sweep.target,
            str(len(sweep.angle)),
            f"{low:.1f}",
            f"{high:.1f}",
            f"{sweep.radius:.1f}",
            f"{sweep.error_range / DEG:.4f}",
            wording.millimetres(sweep.error_range * LEVER_MM),
            *_reversal(sweep),
        )
    shown.caption = (
        "Reversal: what readings on the way up show more than those on the way down; above zero the joint rests beyond "
        "its target (backlash), below zero it stops short (lost motion). A '-' was measured in one direction only."
    )
    shown.caption_justify = "left"
    yield shown
    if any(sweep.axis is not None for sweep in sweeps):
        yield _axes(sweeps)
    yield warnings(remarks)


def _reversal(sweep: JointSweep) -> tuple[str, str]:
    if sweep.reversal is None:
        return "-", "-"
    u = "-" if sweep.u_reversal is None else f"{2.0 * sweep.u_reversal / DEG:.4f}"
    return f"{sweep.reversal / DEG:+.4f}", u


def _axes(sweeps: Sequence[JointSweep]) -> RenderableType:
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
                f"{axis.angle / DEG:.4f}",
                f"{2.0 * axis.u_angle / DEG:.4f}",
                wording.millimetres(axis.distance),
                wording.millimetres(2.0 * axis.u_distance),
            )
    shown.caption = (
        "k = 2: what the scatter about the circle leaves open. More than that is what bends the circle: gravity that "
        "turns with the joint, and the joint's own error over a part of a turn."
    )
    shown.caption_justify = "left"
    return shown
