"""The body of a regression, as `--json` of the command line has it. `service.results` makes it; a test compares."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from service.http.wire.bodies.results import DataShown, Share, Warnings
from service.http.wire.bodies.told import Answered, told


class ByAxis(Answered):
    """An error by axis, um."""

    x: Annotated[float | None, told("Along x, um.", 31.0)]
    y: Annotated[float | None, told("Along y, um.", 29.0)]
    z: Annotated[float | None, told("Along z, um.", 35.0)]
    mean: Annotated[float | None, told("Mean of the three, um.", 31.7)]


class ErrorsByAxis(Answered):
    """Errors by axis, um."""

    mae: Annotated[ByAxis, told("Mean absolute, um.", {"mean": 31.7})]
    rmse: Annotated[ByAxis, told("Root mean square, um.", {"mean": 40.2})]


class RegressionChoice(Answered):
    """The constants that were chosen."""

    gamma: Annotated[float, told("Weight of the errors, no unit.", 100.0)]
    share: Annotated[float, told("lambda of the paper, no unit.", 0.5, alias="lambda")]
    left_out_rms_mm: Annotated[float, told("RMS on what was left out, mm.", 0.05)]


class RegressionRow(Answered):
    """A predictor of the comparison."""

    name: Annotated[str, told("Its name.", "level 3")]
    in_sample: Annotated[ErrorsByAxis, told("On the readings that it was fitted to, um.", {})]
    by_waypoint: Annotated[ErrorsByAxis, told("On waypoints that were left out, um.", {})]
    regression: Annotated[RegressionChoice | None, told("Where one took part.", None)]


class TurnedWrist(Answered):
    """The correction of a regression where nothing was measured."""

    name: Annotated[str, told("Its name.", "mls-svr on residuals of level 3")]
    joint: Annotated[int, told("Number of the joint that is turned.", 4)]
    turned_deg: Annotated[float, told("By, deg.", 90.0)]
    mean_mm: Annotated[float, told("Mean distance from the model, mm.", 0.3)]
    max_mm: Annotated[float, told("Largest distance from the model, mm.", 1.1)]
    within_region: Share


class RegressionQuestion(Answered):
    """The regression that was asked for."""

    name: Annotated[str, told("In words.", "mls-svr on residuals of level 3")]
    on: Annotated[Literal["residuals", "positions"], told("What it learns.", "residuals")]
    level: Annotated[int | None, told("Level of the model, 2 or 3; no unit.", 3)]
    features: Annotated[str, told("Its features.", "closed-form")]
    kernel: Annotated[Literal["linear", "rbf"], told("Its kernel.", "linear")]
    columns: Annotated[int, told("Number of columns.", 120)]
    independent_columns: Annotated[int, told("Number of independent ones.", 96)]


class RegressionResult(Answered):
    """MLS-SVR beside the models (`truepose-regression/1`)."""

    format: Annotated[Literal["truepose-regression/1"], told("The format.", "truepose-regression/1")]
    data: Annotated[DataShown, told("The readings.", {"readings": 300})]
    method: Annotated[Literal["mls-svr"], told("The method.", "mls-svr")]
    asked: Annotated[RegressionQuestion, told("The options of the question.", {"on": "residuals"})]
    samples: Annotated[int, told("Number of samples.", 180)]
    waypoints: Annotated[int, told("Number of waypoints.", 60)]
    table_um: Annotated[list[RegressionRow], told("Errors of every predictor, um.", [])]
    turned_wrist: Annotated[list[TurnedWrist], told("Far from the readings.", [])]
    findings: Annotated[list[str], told("In sentences.", [])]
    warnings: Warnings = Field(default_factory=list)
