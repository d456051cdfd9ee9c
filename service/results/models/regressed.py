"""A regression beside the models with what is said of it, for the command line and for the jobs of the service."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.comparison import ComparisonRequest, RegressionComparison, away, compare
from calib.data import read_dataset
from calib.fit import silent
from calib.regression import RegressionRequest, products_of, usual
from calib.saved import save_model
from service.results.models.regression_document import of_regression


@dataclass(frozen=True)
class RegressionOutcome:
    """The results of regression and identification on the same readings, and the document of it."""

    comparison: RegressionComparison
    document: dict[str, Any]

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
        """Read and compare; the options are those of `truepose regress`. Raises DataError."""
        dataset = read_dataset(data)
        robot = dataset.header.robot
        features = usual(robot, dataset.conditions.joints) if features is None else features
        products_of(features, robot)  # refused before the work, not after it
        plan = ComparisonRequest(RegressionRequest.of(on, features, kernel), level, both, diagnosed)
        found = compare(dataset, plan, progress=say)
        return RegressionOutcome(found, of_regression(found, away(found)))

    @property
    def gains(self) -> bool:
        """Whether the regression that was asked for adds anything to its model."""
        return self.comparison.asked.predictor.regression is not None

    def save(self, path: Path | None) -> str | None:
        """The hash of the model with its regression, where there is a model; path: None writes nothing. Raises
        DataError."""
        asked = self.comparison.asked.predictor
        if asked.found is None or (path is None and not asked.found.converged):
            return None
        return save_model(path, asked.found, regression=asked.regression)

    def report(self, model_sha256: str | None) -> str:
        """The report as HTML. model_sha256: as `save` returns it."""
        from service.report import regression_report  # drawing takes long to import

        return regression_report(self.comparison, self.document, model_sha256)
