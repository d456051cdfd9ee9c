"""An identification with what is said of it, for the command line and for the jobs of the service."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from calib.array import Array
from calib.data import LEVELS, Dataset
from calib.fit import (
    ErrorStatistics,
    IdentificationFit,
    base_model_of,
    errors_on,
    identify,
    place_nominal,
    silent,
    statistics_of,
    worse,
)
from calib.model import ModelStructure
from calib.prior import TypePrior
from calib.saved import CalibratedModel
from service.results.judgement.acceptance import BASE, AcceptanceLimits, AcceptanceResult, decide
from service.results.models import documents


@dataclass(frozen=True)
class IdentificationReport:
    """The findings in a data set, and the errors on its validation rows before, `nominal` as `placed`, and after."""

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
        """Identify. level: 1 to 3, instead of what the header frees; limits: errors to be held to; prior: what
        robots of the type share. Raises DataError."""
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
        """Whether the model misses held-out readings by more than the nominal robot in its place does."""
        return worse(self.error_identified, self.error_nominal)

    def document(self) -> dict[str, Any]:
        """Document of the result (`truepose-identification/1`)."""
        document = documents.of_identification(
            self.dataset, self.found, self.error_nominal, self.error_identified
        )
        if self.acceptance is not None:
            document["acceptance"] = self.acceptance.document()
        return document

    def report(self, model_sha256: str | None, preliminary: CalibratedModel | None = None) -> str:
        """The report as HTML. model_sha256: as `save_model` returns it, None of a fit that did not converge;
        preliminary: of stage 1 of a ballbar campaign, set beside the other two."""
        from service.report import identification_report  # drawing takes long to import

        models = (self.dataset, self.found, self.nominal, self.placed)
        return identification_report(*models, self.document(), self.acceptance, model_sha256, preliminary)
