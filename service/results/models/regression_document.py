"""The JSON document of `regress`, `truepose-regression/1`, and what it finds, in words worked out from its figures.

Errors are in micrometres, as in the table of Khanesar et al. 2022: along x, y and z of the world, and their mean; the
mean of RMS values is quadratic.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.array import Array
from calib.comparison import (
    DIAGNOSIS,
    NOMINAL,
    TURN,
    RegressionComparison,
    Scored,
    TurnedPostureTest,
    mae,
    rmse,
)
from calib.regression import evaluate, independent, products_of
from calib.units import DEG, percent
from service.results.common import DataShown
from service.results.shape import document_of

REGRESSION_FORMAT = "truepose-regression/1"
UM = 1e3
_AXES = ("x", "y", "z", "mean")
_WORSE = 1.02
_MANY = 50.0  # times, from which on a share in per cent says nothing


def of_regression(comparison: RegressionComparison, turned: tuple[TurnedPostureTest, ...]) -> dict[str, Any]:
    """The document of a comparison."""
    plan, asked = comparison.plan, comparison.asked
    return {
        "format": REGRESSION_FORMAT,
        "data": document_of(DataShown.of(comparison.dataset)),
        "method": "mls-svr",
        "asked": {
            "name": asked.predictor.name,
            "on": plan.wanted.on,
            "level": None if plan.wanted.on == "positions" else plan.level,
            "features": plan.wanted.features,
            "kernel": plan.wanted.kernel,
            **columns_of(comparison),
        },
        "samples": len(comparison.rows),
        "waypoints": waypoints(comparison),
        "table_um": [
            {
                "name": scored.predictor.name,
                "in_sample": _errors(scored.in_sample),
                "by_waypoint": _errors(scored.by_waypoint),
                "regression": _choice(scored),
            }
            for scored in comparison.scored
        ],
        "turned_wrist": [
            {
                "name": each.name,
                "joint": each.joint,
                "turned_deg": TURN / DEG,
                "mean_mm": each.mean,
                "max_mm": each.largest,
                "within_region": each.inside,
            }
            for each in turned
        ],
        "findings": findings(comparison, turned),
    }


def waypoints(comparison: RegressionComparison) -> int:
    """Number of waypoints of the samples."""
    return len(np.unique(comparison.waypoint))


def columns_of(comparison: RegressionComparison) -> dict[str, int]:
    """Numbers of columns that the features have, and that are independent at these samples."""
    joints = comparison.dataset.conditions.joints[comparison.rows]
    products = products_of(comparison.plan.wanted.features, comparison.dataset.header.robot)
    return {"columns": len(products), "independent_columns": independent(evaluate(products, joints))}


def findings(comparison: RegressionComparison, turned: tuple[TurnedPostureTest, ...]) -> list[str]:
    """The findings from the figures, as sentences."""
    by_name = {s.predictor.name: s for s in comparison.scored}
    out = []
    regressed = [s for s in comparison.scored if s.predictor.asked]
    fitted = [s for s in comparison.scored if not s.predictor.asked and s.predictor.name != NOMINAL]
    if fitted:
        best = min(fitted, key=lambda s: _mae(s.by_waypoint))
        nominal = _mae(by_name[NOMINAL].by_waypoint)
        out.append(
            f"Of the physical models {best.predictor.name} errs least on waypoints left out: "
            f"{_mae(best.by_waypoint):.1f} um, {_change(_mae(best.by_waypoint), nominal)} than the nominal robot in "
            "its place."
        )
    if DIAGNOSIS in by_name:
        base = f"level {comparison.plan.level}"
        change = _change(_mae(by_name[DIAGNOSIS].by_waypoint), _mae(by_name[base].by_waypoint))
        inside, outside = _mae(by_name[DIAGNOSIS].in_sample), _mae(by_name[DIAGNOSIS].by_waypoint)
        out.append(
            f"The diagnosis leaves {inside:.1f} um in sample and {outside:.1f} um on waypoints left out, {change} than "
            f"{base} alone."
        )
    for scored in regressed:
        alone = by_name.get(scored.predictor.name.partition(" residuals of ")[2])
        inside, outside = _mae(scored.in_sample), _mae(scored.by_waypoint)
        if alone is None:
            rivals = [s for s in fitted if s.predictor.name == f"level {comparison.plan.level}"]
            against = "".join(
                f"; {s.predictor.name} {_mae(s.by_waypoint):.1f} um ({_change(_mae(s.by_waypoint), outside)})"
                for s in rivals
            )
            out.append(
                f"{scored.predictor.name}: {inside:.1f} um in sample, {outside:.1f} um on waypoints left out{against}."
            )
        elif scored.predictor.regression is None:
            out.append(
                f"{scored.predictor.name}: nothing was gained for certain on waypoints left out, so nothing is added."
            )
        else:
            model = _mae(alone.by_waypoint)
            verdict = "" if outside <= _WORSE * model else " It makes the model worse."
            out.append(
                f"{scored.predictor.name}: {outside:.1f} um on waypoints left out, {_change(outside, model)} than "
                f"{alone.predictor.name} alone.{verdict}"
            )
    for each in turned:
        refused = "refuses" if each.inside == 0.0 else f"refuses {percent(1.0 - each.inside)} of"
        of = "the fitted model" if "positions" in each.name else "its own model"
        out.append(
            f"With joint {each.joint} turned by {TURN / DEG:.0f} deg at every sample {each.name} is {each.mean:.3f} mm "
            f"(at most {each.largest:.3f} mm) from {of}; its region {refused} these postures."
        )
    return out


def _errors(errors: Array) -> dict[str, dict[str, float]]:
    return {
        "mae": dict(zip(_AXES, (UM * mae(errors)).tolist(), strict=True)),
        "rmse": dict(zip(_AXES, (UM * rmse(errors)).tolist(), strict=True)),
    }


def _choice(scored: Scored) -> dict[str, float] | None:
    regression = scored.predictor.regression
    if regression is None:
        return None
    return {"gamma": regression.svr.gamma, "lambda": regression.svr.share, "left_out_rms_mm": regression.rms}


def _mae(errors: Array) -> float:
    return float(UM * mae(errors)[3])


def _change(value: float, than: float) -> str:
    change = value / than - 1.0
    if value * _MANY < than:
        return f"{than / value:,.0f} times less"
    return f"{percent(abs(change))} {'more' if change > 0.0 else 'less'}"
