"""Tables of the robots of one type: type statistics, and share of the prior in a fit."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import RenderableType
from rich.text import Text

from calib.fit import IdentificationFit
from calib.prior import TypeStatistics
from calib.units import percent
from service import wording
from service.printed import tables

_HARDLY = 0.05  # p-value of the whole robot, at or below which it is hardly within its type


def weights(found: IdentificationFit) -> Sequence[RenderableType]:
    """Show the share of the prior in each parameter; nothing if the fit used no type."""
    beside = found.beside
    if beside is None:
        return ()
    table = tables.grid(
        f"Compared with {beside.prior.robots} robots of the type {beside.prior.robot}",
        "parameter",
        "unit",
        "mean of the type",
        "spread",
        "decided by the prior",
        "off, in spreads",
        left=2,
    )
    for each in found.weighed:
        off = f"{each.z:+.1f}" if math.isfinite(each.z) else "not seen"
        share = percent(each.decided)
        unit = beside.prior.shares[each.name].unit
        table.add_row(each.name, unit, f"{each.centre:.4g}", f"{each.spread:.2g}", share, off)
    for each in beside.outside:
        unit = beside.prior.shares[each.name].unit
        table.add_row(
            each.name, unit, f"{each.centre:.4g}", f"{each.spread:.2g}", "left out", f"{each.z:+.1f}"
        )
    if not table.row_count and not beside.left_out:
        return (Text("The type says nothing that this fit could use."),)
    within = "within" if beside.p_value > _HARDLY else "hardly within"
    verdict = "outside" if beside.left_out else within
    return (
        *((table,) if table.row_count else ()),
        Text(
            f"As a whole this robot lies {verdict} its type: chi-squared {beside.chi_square:.0f} over "
            f"{beside.freedom}, p = {wording.chance(beside.p_value)}."
        ),
    )


def lesson(found: TypeStatistics) -> Sequence[RenderableType]:
    """Show the type statistics for people."""
    robots = len(found.members)
    table = tables.grid(
        f"{robots} robots of the type {found.members[0].saved.model.robot.name}",
        "parameter",
        "unit",
        "robots",
        "mean ± U (k = 2)",
        "spread ± U (k = 2)",
        "next robot",
        "usual size",
        left=2,
    )
    for p in found.parameters:
        table.add_row(
            p.name,
            p.unit,
            f"{p.robots}",
            " ± ".join(wording.with_uncertainty(p.mean, 2.0 * p.mean_std)),
            " ± ".join(wording.with_uncertainty(p.spread, 2.0 * p.spread_std)),
            f"{p.of_next:.3g}" if p.kept else "not better",
            "free" if p.usual is None else f"{p.usual:g}",
        )
    shown: list[RenderableType] = [table]
    if found.found:
        effects = tables.grid("Effects beside the base model", "effect", "robots", "share")
        for each in found.found:
            effects.add_row(each.label, f"{each.robots}", percent(each.robots / robots))
        shown.append(effects)
    if found.outliers:
        outside = tables.grid(
            "Outside the type, and not learnt from", "model", "parameter", "value", "off by", left=2
        )
        for each in found.outliers:
            outside.add_row(each.robot, each.parameter, f"{each.value:.4g} {each.unit}", f"{each.z:+.1f}")
        shown.append(outside)
    shown.append(tables.warnings([f"{name} was left out whole: {why}." for name, why in found.left_out]))
    return shown
