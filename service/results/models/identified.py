"""Result document of an identification (`truepose-identification/1`), and its calculation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import SkipValidation

from calib.array import Array
from calib.data import LEVELS, Dataset
from calib.fit import (
    ErrorStatistics,
    IdentificationFit,
    UncertaintyMap,
    base_model_of,
    errors_on,
    identify,
    place_nominal,
    silent,
    statistics_of,
    uncertainty_map,
    worse,
)
from calib.model import ModelStructure
from calib.prior import TypePrior
from calib.saved import CalibratedModel
from service.results.common import (
    ERRORS,
    DataShown,
    ErrorStatisticsResponse,
    FitShown,
    ParameterResponse,
    Reading,
    Share,
)
from service.results.judgement.acceptance import BASE, AcceptanceLimits, AcceptanceResult, decide
from service.results.models.parameters import high_leverage, rows_of, strong_correlations
from service.results.shape import Real, ResponseBody, document_of, told

if TYPE_CHECKING:
    from service.report.certificate import CertificateParties


class Correlation(ResponseBody):
    """Two parameters whose errors go together."""

    between: Annotated[list[str], told("Their names.", ["a2", "d4"])]
    correlation: Annotated[Real, told("From -1 to 1, no unit.", 0.93)]


class Leverage(ResponseBody):
    """A reading on which the fit leans."""

    reading: Reading
    leverage: Share


class Spread(ResponseBody):
    """Expanded uncertainty of predicted positions, mm."""

    median: Annotated[Real, told("Median, mm.", 0.14)]
    p95: Annotated[Real, told("95 % of them are less, mm.", 0.26)]
    max: Annotated[Real, told("The largest, mm.", 0.41)]

    @classmethod
    def of(cls, u: Array) -> Self | None:
        """Return the spread of values (n,); None if there are none."""
        return cls(median=np.median(u), p95=np.quantile(u, 0.95), max=u.max()) if len(u) else None


class PredictedU(ResponseBody):
    """The expanded uncertainty of predicted positions."""

    coverage_factor: Annotated[float, SkipValidation, told("Number of standard uncertainties.", 2)]
    measured_ranges: Annotated[Spread | None, told("Within the measured joint ranges, mm.", None)]
    outside_them: Annotated[Spread | None, told("Outside of them, mm.", None)]
    radius_95_measured_ranges: Annotated[
        Spread | None, told("Radius that contains 95 %, within the measured joint ranges, mm.", None)
    ] = None
    radius_95_outside_them: Annotated[
        Spread | None, told("Radius that contains 95 %, outside of them, mm.", None)
    ] = None

    @classmethod
    def of(cls, found: UncertaintyMap) -> Self:
        """Expanded uncertainty (k = 2) and 95 % radius, within the measured joint ranges and outside."""
        within = found.measured
        return cls(
            coverage_factor=2,
            measured_ranges=Spread.of(found.u[within]),
            outside_them=Spread.of(found.u[~within]),
            radius_95_measured_ranges=Spread.of(found.radius_95[within]),
            radius_95_outside_them=Spread.of(found.radius_95[~within]),
        )


class IdentificationResult(FitShown):
    """An identification (`truepose-identification/1`)."""

    format: Annotated[Literal["truepose-identification/1"], told("The format.", "truepose-identification/1")]
    parameters: Annotated[list[ParameterResponse], told("Every parameter.", [])]
    correlations: Annotated[list[Correlation], told("Those above 0.9.", [])]
    high_leverage: Annotated[list[Leverage], told("Readings on which the fit leans.", [])]
    predicted_u_mm: Annotated[
        PredictedU, told("Expanded uncertainty of positions, mm.", {"coverage_factor": 2})
    ]
    error_identified_mm: Annotated[
        ErrorStatisticsResponse | None, told("Of the identified model, on readings held out, mm.", ERRORS)
    ]


@dataclass(frozen=True)
class IdentificationReport:
    """Result of an identification, with the errors on its validation rows before and after.

    The errors before are those of the `nominal` model at the estimate `placed`.
    """

    dataset: Dataset
    found: IdentificationFit
    nominal: ModelStructure
    placed: Array
    error_nominal: ErrorStatistics | None
    error_identified: ErrorStatistics | None
    acceptance: AcceptanceResult | None = None

    @staticmethod
    def of(
        dataset: Dataset,
        level: int | None = None,
        say: Callable[[str], None] = silent,
        limits: AcceptanceLimits | None = None,
        prior: TypePrior | None = None,
    ) -> IdentificationReport:
        """Identify the base model of a data set.

        Parameters
        ----------
        level : int, optional
            Level 1 to 3 of the parameters to free. Default: those that the header frees.
        limits : AcceptanceLimits, optional
            Limits with which the errors on validation rows are compared.
        prior : TypePrior, optional
            Prior learned from robots of the same type.

        Raises
        ------
        DataError
            The model cannot be identified from the data set, or the limits cannot be judged on it.
        """
        if limits is not None:
            limits.refuse_unjudged(dataset)
        groups = None if level is None else LEVELS[level]
        found = identify(dataset, groups=groups, prior=prior, progress=say)
        nominal, placed = place_nominal(dataset, base_model_of(dataset, groups))
        rows = dataset.validation_rows
        before = statistics_of(errors_on(dataset, rows, nominal, placed))
        after = statistics_of(errors_on(dataset, rows, found.model, found.estimate))
        verdict = None
        if limits is not None:
            verdict = decide(limits, dataset, rows, found.model, found.estimate, BASE)
        return IdentificationReport(dataset, found, nominal, placed, before, after, verdict)

    @property
    def worse_than_nominal(self) -> bool:
        """Whether the error on held-out readings exceeds that of the nominal robot in its place."""
        return worse(self.error_identified, self.error_nominal)

    def document(self) -> dict[str, Any]:
        """Build the document of the result (`truepose-identification/1`)."""
        dataset, found = self.dataset, self.found
        result = IdentificationResult.model_validate(
            {
                "format": "truepose-identification/1",
                "data": DataShown.of(dataset),
                "parameters": rows_of(found),
                **FitShown.fit_members(dataset, found),
                "correlations": [
                    Correlation(between=[a, b], correlation=r) for a, b, r in strong_correlations(found)
                ],
                "high_leverage": [
                    Leverage(reading=dataset.reading_id[row], leverage=share)
                    for row, share in high_leverage(found)
                ],
                "predicted_u_mm": PredictedU.of(uncertainty_map(found)),
                "error_nominal_mm": self.error_nominal,
                "error_identified_mm": self.error_identified,
                "holdout": dataset.header.holdout,
                **({} if self.acceptance is None else {"acceptance": self.acceptance}),
            }
        )
        return document_of(result)

    def report(
        self,
        document: Mapping[str, Any],
        model_sha256: str | None,
        preliminary: CalibratedModel | None = None,
        parties: CertificateParties | None = None,
    ) -> str:
        """Create the report as HTML.

        Parameters
        ----------
        document : mapping
            The JSON of the result, as `document` builds it; the report contains a copy.
        model_sha256 : str or None
            Hash that `save_model` returned; None if the fit did not converge.
        preliminary : CalibratedModel, optional
            Model of stage 1 of a ballbar campaign, compared with the other two models.
        parties : CertificateParties, optional
            Laboratory, customer, place and who signs, for the first page.
        """
        from service.report import identification_report  # drawing takes long to import

        models = (self.dataset, self.found, self.nominal, self.placed)
        return identification_report(*models, document, self.acceptance, model_sha256, preliminary, parties)
