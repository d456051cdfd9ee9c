"""The bodies of jobs: what was asked for, and what it came to."""

from __future__ import annotations

from typing import Annotated, Literal

from acquisition import State
from service.http.wire.bodies.alignments import AlignmentResult
from service.http.wire.bodies.diagnoses import DiagnosisResult
from service.http.wire.bodies.placements import PlacementsResult, Progress
from service.http.wire.bodies.problem import ProblemShown
from service.http.wire.bodies.regressions import RegressionResult
from service.http.wire.bodies.results import IdentificationResult
from service.http.wire.bodies.runs import StateCode
from service.http.wire.bodies.selections import SelectionResult
from service.http.wire.bodies.told import Answered, Created, Id, told
from service.http.wire.bodies.validations import ValidationResult
from service.http.wire.bodies.watches import UpkeepResult, WatchPlanResult, WatchResult

JobKind = Literal[
    "identification", "diagnosis", "alignment", "regression", "validation", "selection", "placement", "watch_plan",
    "watch", "upkeep",
]  # fmt: skip
Result = (
    IdentificationResult
    | DiagnosisResult
    | AlignmentResult
    | RegressionResult
    | ValidationResult
    | SelectionResult
    | PlacementsResult
    | WatchPlanResult
    | WatchResult
    | UpkeepResult
)


class JobKept(Answered):
    """A job as it was asked for."""

    id: Id
    kind: Annotated[JobKind, told("What was asked for.", "diagnosis")]
    dataset_id: Annotated[
        str,
        told(
            "Its readings; of an alignment those it made; empty where there are none.",
            "20261121-170459-3f9a1",
        ),
    ]
    created_utc: Created


class ProblemKept(Answered):
    """The kept reason why a job could not be done."""

    text: Annotated[str, told("What happened.", "The robot and the points do not belong together.")]
    do: Annotated[str, told("What to do.", "Look at line 12.")]


class _Job(JobKept):
    state: Annotated[State, told("ready: it waits for its turn; running, succeeded or failed.", "succeeded")]
    state_code: StateCode
    version: Annotated[int, told("1 ready, 2 running, 3 over; no unit. Ask with `after=2` for the end.", 3)]
    problem: Annotated[ProblemShown | None, told("Once it has failed.", None)]
    step: Annotated[str, told("What it does now, in words; empty where it does not say.", "reading")] = ""
    report: Annotated[
        str | None, told("The path of its report.", "/api/v1/reports/20261121-170459-3f9a1c07b2e")
    ]


class JobShown(_Job):
    """A job of any kind; `result` once it has succeeded, `problem` once it has failed."""

    result: Annotated[Result | None, told("Once it has succeeded; `format` says which it is.", None)]


class IdentificationShown(_Job):
    """An identification."""

    result: Annotated[IdentificationResult | None, told("Once it has succeeded.", None)]


class DiagnosisShown(_Job):
    """A diagnosis."""

    result: Annotated[DiagnosisResult | None, told("Once it has succeeded.", None)]


class AlignmentShown(_Job):
    """An alignment of two streams."""

    result: Annotated[AlignmentResult | None, told("Once it has succeeded.", None)]


class RegressionShown(_Job):
    """A regression beside the models of a data set."""

    result: Annotated[RegressionResult | None, told("Once it has succeeded.", None)]


class ValidationShown(_Job):
    """A validation."""

    result: Annotated[ValidationResult | None, told("Once it has succeeded.", None)]


class SelectionShown(_Job):
    """A selection of poses."""

    result: Annotated[SelectionResult | None, told("Once it has succeeded.", None)]


class PlacementsShown(_Job):
    """A search of placements."""

    progress: Annotated[Progress | None, told("How far it is, once it has begun.", None)] = None
    result: Annotated[PlacementsResult | None, told("Once it has succeeded.", None)]


class BaselineShown(Answered):
    """The model that a watch is judged by."""

    id: Annotated[str, told("The id of its job, or the hash of a document.", "20261121-170459-3f9a1c07b2e")]
    sha256: Annotated[str, told("The hash by which the history knows it.", "a93c6fe1")]


class _Watched(_Job):
    baseline: Annotated[BaselineShown, told("The model of the calibration.", {"id": "20261121-170459-3f9a1"})]


class WatchPlanShown(_Watched):
    """The plan of a watch."""

    result: Annotated[WatchPlanResult | None, told("Once it has succeeded.", None)]


class WatchShown(_Watched):
    """A watch."""

    result: Annotated[WatchResult | None, told("Once it has succeeded.", None)]


class UpkeepShown(_Watched):
    """An upkeep."""

    result: Annotated[UpkeepResult | None, told("Once it has succeeded.", None)]


class WatchPlansShown(Answered):
    """Plans of watches."""

    watch_plans: Annotated[list[WatchPlanShown], told("Newest first.", [])]


class WatchesShown(Answered):
    """Watches."""

    watches: Annotated[list[WatchShown], told("Newest first.", [])]


class UpkeepsShown(Answered):
    """Upkeeps."""

    upkeeps: Annotated[list[UpkeepShown], told("Newest first.", [])]


class JobsShown(Answered):
    """The jobs of a data set."""

    jobs: Annotated[list[JobShown], told("Newest first.", [])]
