"""Result of a regression compared with the models (`truepose-regression/1`).

Its findings are sentences derived from the numbers. Errors are in micrometres along x, y and z of the world, with
their mean, as in the table of Khanesar et al. 2022. The mean of RMS values is quadratic.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np
from pydantic import ConfigDict, Field

from calib.array import Array
from calib.data import read_dataset
from calib.fit import silent
from calib.regression import RegressionRequest, evaluate, flipped, independent, like_ur, products_of, usual
from calib.saved import save_model
from calib.units import DEG, percent
from service.results.common import DataShown, Share, Warnings
from service.results.shape import ResponseBody, told

if TYPE_CHECKING:  # it is long to import, and the service describes results without it
    from calib.comparison import RegressionComparison, TurnedPostureTest

_UM = 1e3
_WORSE = 1.02
_MANY = 50.0  # times, from which on a share in per cent says nothing


class ByAxis(ResponseBody):
    """An error by axis, um."""

    x: Annotated[float | None, told("Along x, um.", 31.0)]
    y: Annotated[float | None, told("Along y, um.", 29.0)]
    z: Annotated[float | None, told("Along z, um.", 35.0)]
    mean: Annotated[float | None, told("Mean of the three, um.", 31.7)]


class ErrorsByAxis(ResponseBody):
    """Errors by axis, um."""

    mae: Annotated[ByAxis, told("Mean absolute, um.", {"mean": 31.7})]
    rmse: Annotated[ByAxis, told("Root mean square, um.", {"mean": 40.2})]

    @classmethod
    def of(cls, errors: Array) -> Self:
        """Compute the errors by axis from errors (n, 3), mm."""
        from calib.comparison import mae, rmse

        by_axis = [dict(zip(ByAxis.model_fields, _UM * each(errors), strict=True)) for each in (mae, rmse)]
        return cls.model_validate(dict(zip(cls.model_fields, by_axis, strict=True)))


class RegressionChoice(ResponseBody):
    """The constants that were chosen."""

    model_config = ConfigDict(serialize_by_alias=True)

    gamma: Annotated[float, told("Weight of the errors, no unit.", 100.0)]
    share: Annotated[float, told("lambda of the paper, no unit.", 0.5, alias="lambda")]
    left_out_rms_mm: Annotated[float, told("RMS on what was left out, mm.", 0.05)]


class RegressionRow(ResponseBody):
    """A predictor of the comparison."""

    name: Annotated[str, told("Its name.", "level 3")]
    in_sample: Annotated[ErrorsByAxis, told("On the readings that it was fitted to, um.", {})]
    by_waypoint: Annotated[ErrorsByAxis, told("On waypoints that were left out, um.", {})]
    regression: Annotated[RegressionChoice | None, told("Where one took part.", None)]


class TurnedWrist(ResponseBody):
    """The correction of a regression where nothing was measured."""

    name: Annotated[str, told("Its name.", "mls-svr on residuals of level 3")]
    joint: Annotated[int, told("Number of the joint that is turned.", 4)]
    turned_deg: Annotated[float, told("By, deg.", 90.0)]
    mean_mm: Annotated[float, told("Mean distance from the model, mm.", 0.3)]
    max_mm: Annotated[float, told("Largest distance from the model, mm.", 1.1)]
    within_region: Share


class RegressionSettings(ResponseBody):
    """The requested regression."""

    name: Annotated[str, told("In words.", "mls-svr on residuals of level 3")]
    on: Annotated[Literal["residuals", "positions"], told("What it learns.", "residuals")]
    level: Annotated[int | None, told("Level of the model, 2 or 3; no unit.", 3)]
    features: Annotated[str, told("Its features.", "closed-form")]
    kernel: Annotated[Literal["linear", "rbf"], told("Its kernel.", "linear")]
    columns: Annotated[int, told("Number of columns.", 120)]
    independent_columns: Annotated[int, told("Number of independent ones.", 96)]


class RegressionResult(ResponseBody):
    """The result of MLS-SVR compared with the models (`truepose-regression/1`)."""

    format: Annotated[Literal["truepose-regression/1"], told("The format.", "truepose-regression/1")]
    data: Annotated[DataShown, told("The readings.", {"readings": 300})]
    method: Annotated[Literal["mls-svr"], told("The method.", "mls-svr")]
    asked: Annotated[RegressionSettings, told("The options of the question.", {"on": "residuals"})]
    samples: Annotated[int, told("Number of samples.", 180)]
    waypoints: Annotated[int, told("Number of waypoints.", 60)]
    table_um: Annotated[list[RegressionRow], told("Errors of every predictor, um.", [])]
    turned_wrist: Annotated[list[TurnedWrist], told("Far from the readings.", [])]
    findings: Annotated[list[str], told("In sentences.", [])]
    warnings: Warnings = Field(default_factory=list)

    @classmethod
    def of(cls, comparison: RegressionComparison) -> Self:
        """Build the result of a comparison."""
        from calib.comparison import TURN, away

        plan, turned, rows = comparison.plan, away(comparison), comparison.rows
        products = products_of(plan.wanted.features, comparison.dataset.header.robot)
        columns = evaluate(products, comparison.dataset.conditions.joints[rows])
        return cls.model_validate(
            {
                "format": "truepose-regression/1",
                "data": DataShown.of(comparison.dataset),
                "method": "mls-svr",
                "asked": {
                    "name": comparison.asked.predictor.name,
                    "on": plan.wanted.on,
                    "level": None if plan.wanted.on == "positions" else plan.level,
                    "features": plan.wanted.features,
                    "kernel": plan.wanted.kernel,
                    "columns": len(products),
                    "independent_columns": independent(columns),
                },
                "samples": len(rows),
                "waypoints": len(np.unique(comparison.waypoint)),
                "table_um": [
                    {
                        "name": scored.predictor.name,
                        "in_sample": ErrorsByAxis.of(scored.in_sample),
                        "by_waypoint": ErrorsByAxis.of(scored.by_waypoint),
                        "regression": None
                        if (chosen := scored.predictor.regression) is None
                        else {
                            "gamma": chosen.svr.gamma,
                            "lambda": chosen.svr.share,
                            "left_out_rms_mm": chosen.rms,
                        },
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
        )


@dataclass(frozen=True)
class RegressionOutcome:
    """Comparison of regression and identification on the same readings, with its result."""

    comparison: RegressionComparison
    result: RegressionResult

    @staticmethod
    def of(
        data: Path,
        *,
        on: str = "residuals",
        features: str | None = None,
        kernel: str = "linear",
        level: int = 3,
        both: bool = False,
        diagnosed: bool = False,
        say: Callable[[str], None] = silent,
    ) -> RegressionOutcome:
        """Read a data set and compare the predictors; the options are those of `truepose regress`.

        Raises
        ------
        DataError
            The data set cannot be read or compared, or the features do not suit the robot.
        """
        from calib.comparison import ComparisonRequest, compare

        dataset = read_dataset(data)
        robot = dataset.header.robot
        features = usual(robot, dataset.conditions.joints) if features is None else features
        products_of(features, robot)  # refused before the work, not after it
        plan = ComparisonRequest(RegressionRequest.of(on, features, kernel), level, both, diagnosed)
        found = compare(dataset, plan, progress=say)
        return RegressionOutcome(found, RegressionResult.of(found))

    @property
    def gains(self) -> bool:
        """Whether the requested regression adds anything to its model."""
        return self.comparison.asked.predictor.regression is not None

    def save(self, path: Path | None) -> str | None:
        """Save the model with its regression and return its hash.

        Parameters
        ----------
        path : Path or None
            None writes nothing.

        Returns
        -------
        str or None
            Hash of the model. None if there is no model, or if `path` is None and the fit did not converge.

        Raises
        ------
        DataError
            The model cannot be saved.
        """
        asked = self.comparison.asked.predictor
        if asked.found is None or (path is None and not asked.found.converged):
            return None
        return save_model(path, asked.found, regression=asked.regression)


def findings(comparison: RegressionComparison, turned: tuple[TurnedPostureTest, ...]) -> list[str]:
    """Derive the findings from the numbers, as sentences."""
    from calib.comparison import DIAGNOSIS, NOMINAL, TURN

    by_name = {s.predictor.name: s for s in comparison.scored}
    out = []
    regressed = [s for s in comparison.scored if s.predictor.asked]
    fitted = [s for s in comparison.scored if not s.predictor.asked and s.predictor.name != NOMINAL]
    other = flipped(comparison.dataset.conditions.joints[comparison.rows])
    if other.any() and like_ur(comparison.dataset.header.robot):
        few, all_of = (len(np.unique(comparison.waypoint[rows])) for rows in (other, slice(None)))
        out.append(
            f"The wrist is flipped at {few} of {all_of} waypoints: a regression on positions knows that posture from "
            "them alone. Leave them out, or measure more of them."
        )
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


def _mae(errors: Array) -> float:
    return float(_UM * np.abs(errors).mean(axis=0).mean())


def _change(value: float, than: float) -> str:
    change = value / than - 1.0
    if value * _MANY < than:
        return f"{than / value:,.0f} times less"
    return f"{percent(abs(change))} {'more' if change > 0.0 else 'less'}"
