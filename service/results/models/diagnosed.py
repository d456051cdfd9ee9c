"""A diagnosis with what is asked beside it, for the command line, the jobs of the service and Python."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from acquisition.cell import Cell
from acquisition.loop import fits, in_cell
from calib.data import Dataset
from calib.diagnose import MOST_EFFECTS, CarryOver, DiagnosisFit, carry_over, diagnose
from calib.fit import silent
from calib.prior import TypePrior
from service.results.judgement.acceptance import AcceptanceLimits, AcceptanceResult, decide, judged_as
from service.results.models import documents
from service.results.models.documents import PatchResult


@dataclass(frozen=True)
class DiagnosisRequest:
    """The options of a diagnosis.

    most: number of effects that may be added. prior: what robots of the type share. carry_to: another data set of the
    robot, on which the effects are judged as well. patch: whether a map is made of what is left. cell: what is
    proposed to measure next is kept within it. any_cell: pass over a cell whose robot or targets are not those of the
    data, instead of refusing it. limits: that the error on held-out readings is held to.
    """

    most: int = MOST_EFFECTS
    prior: TypePrior | None = None
    carry_to: Dataset | None = None
    patch: bool = False
    cell: Cell | None = None
    any_cell: bool = False
    limits: AcceptanceLimits | None = None


@dataclass(frozen=True)
class DiagnosisOutcome:
    """A diagnosis, with the effects judged on another data set, the patch and the acceptance that were asked for."""

    diagnosis: DiagnosisFit
    carried: CarryOver | None = None
    patched: PatchResult | None = None
    acceptance: AcceptanceResult | None = None

    @staticmethod
    def of(
        dataset: Dataset, asked: DiagnosisRequest, say: Callable[[str], None] = silent
    ) -> DiagnosisOutcome:
        """Diagnose. say: is told each step. Raises DataError."""
        if asked.limits is not None:
            asked.limits.refuse_unjudged(dataset)
        found = diagnose(dataset, most=asked.most, prior=asked.prior, progress=say)
        cell = asked.cell
        if (
            cell is not None
            and found.follow_up is not None
            and (not asked.any_cell or fits(cell, found.final))
        ):
            say("seeking poses of the cell that distinguish rivals")
            found = replace(found, follow_up=in_cell(cell, found.final, found.follow_up.rivals))
        carried = patched = acceptance = None
        if asked.carry_to is not None:
            say("judging the effects on the other data set")
            carried = carry_over(found, asked.carry_to)
        if asked.patch:
            say("mapping what is left")
            patched = PatchResult.of(found)
        if asked.limits is not None:
            final = (found.final.model, found.final.estimate)
            acceptance = decide(
                asked.limits, dataset, dataset.validation_rows, *final, judged_as(found.effects)
            )
        return DiagnosisOutcome(found, carried, patched, acceptance)

    def document(self) -> dict[str, Any]:
        """Document of the result (`truepose-diagnosis/1`)."""
        document = documents.of_diagnosis(self.diagnosis, self.carried, self.patched)
        if self.acceptance is not None:
            document["acceptance"] = self.acceptance.document()
        return document
