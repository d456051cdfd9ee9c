"""Tables of the robots of one type: type statistics, and share of the prior in a fit."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import RenderableType
from rich.text import Text

from calib.units import percent
from service import wording
from service.printed import tables
from service.results.typed import TypeAgreementResponse, TypeStatisticsResult

_HARDLY = 0.05  # p-value of the whole robot, at or below which it is hardly within its type


def weights(found: TypeAgreementResponse | None) -> Sequence[RenderableType]:
    """Show the share of the prior in each parameter; nothing if the fit used no type."""
    if found is None:
        return ()
    table = tables.grid(
        f"Compared with {found.robots} robots of the type {found.robot}",
        "parameter",
        "unit",
        "mean of the type",
        "spread",
        "decided by the prior",
        "off, in spreads",
        left=2,
    )
    for each in found.parameters:
        off = "not seen" if each.z is None else f"{each.z:+.1f}"
        share = percent(each.weight_of_prior) if each.used else "left out"
        table.add_row(each.name, each.unit, f"{each.centre:.4g}", f"{each.spread:.2g}", share, off)
    if not table.row_count and not found.left_out:
        return (Text("The type says nothing that this fit could use."),)
    within = "within" if found.p_value > _HARDLY else "hardly within"
    verdict = "outside" if found.left_out else within
    return (
        *((table,) if table.row_count else ()),
        Text(
            f"As a whole this robot lies {verdict} its type: chi-squared {found.chi_square:.0f} over "
            f"{found.degrees_of_freedom}, p = {wording.chance(found.p_value)}."
        ),
    )


def lesson(found: TypeStatisticsResult) -> Sequence[RenderableType]:
    """Show the type statistics for people."""
    table = tables.grid(
        f"{found.robots} robots of the type {found.robot}",
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
            effects.add_row(each.label, f"{each.robots}", percent(each.robots / found.robots))
        shown.append(effects)
    if found.outliers:
        outside = tables.grid(
            "Outside the type, and not learnt from", "model", "parameter", "value", "off by", left=2
        )
        for each in found.outliers:
            outside.add_row(each.robot, each.parameter, f"{each.value:.4g} {each.unit}", f"{each.z:+.1f}")
        shown.append(outside)
    shown.append(
        tables.warnings([f"{each.model} was left out whole: {each.because}." for each in found.left_out])
    )
    return shown
