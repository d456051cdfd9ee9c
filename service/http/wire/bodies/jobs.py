"""The bodies of jobs: their requests and their results.

They include the requests for a selection of poses, and for a search of placements of the base balls of a ballbar.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from acquisition import State
from calib.data import DEFAULT_GROUPS
from calib.selection import SHARE
from service.http.wire.bodies.fields import (
    Created,
    Id,
    Prior,
    ProblemShown,
    RequestBody,
    ResponseBody,
    told,
    told_limit,
)
from service.http.wire.bodies.runs import StateCode
from service.http.wire.bodies.watches import WatchPlanResult
from service.results.cell.placements import TOGETHER, PlacementRequest, PlacementsResult
from service.results.cell.selected import SelectionResult
from service.results.files.alignment import AlignmentResult
from service.results.judgement.validation import ValidationResult
from service.results.models.diagnosed import DiagnosisResult
from service.results.models.identified import IdentificationResult
from service.results.models.regressed import RegressionResult
from service.results.models.swept import SweepsResult
from service.results.watch_answers import UpkeepResult, WatchResult

Number = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]


def _range(words: str, default: tuple[float, float, float]) -> Any:
    return told(f"{words}: lowest, highest, step.", list(default), min_length=3, max_length=3)


class PlacementsAsked(RequestBody):
    """The shifts and turns of the base balls to try; the options of `truepose plan-ballbar`."""

    x: Annotated[list[Number], _range("Shift along x of the world, mm", PlacementRequest.x)] = Field(
        default_factory=lambda: list(PlacementRequest.x)
    )
    y: Annotated[list[Number], _range("Shift along y of the world, mm", PlacementRequest.y)] = Field(
        default_factory=lambda: list(PlacementRequest.y)
    )
    z: Annotated[list[Number], _range("Shift along z of the world, mm", PlacementRequest.z)] = Field(
        default_factory=lambda: list(PlacementRequest.z)
    )
    turn: Annotated[list[Number], _range("Turn about the vertical, deg", PlacementRequest.turn)] = Field(
        default_factory=lambda: list(PlacementRequest.turn)
    )
    base: Annotated[
        list[Annotated[str, Field(max_length=100)]] | None,
        told(
            "Three or four balls of the cell; left out: its first three.",
            ["B1", "B2", "B3"],
            min_length=3,
            max_length=4,
        ),
    ] = None
    zone: Annotated[
        list[Number] | None,
        told(
            "Centre x, y, z and radius of a sphere, mm, in which the predicted U ranks; left out: poses do.",
            [300.0, 0.0, 300.0, 200.0],
            min_length=4,
            max_length=4,
        ),
    ] = None
    together: Annotated[
        int,
        told(
            "Number of placements of one plan, which complete each other in the zone.", 1, ge=1, le=TOGETHER
        ),
    ] = 1
    offset_deg: Annotated[
        float,
        told("From how far below every joint arrives, deg.", PlacementRequest.offset_deg, ge=0.1, le=30.0),
    ] = PlacementRequest.offset_deg
    show: Annotated[
        int, told("Number of placements that are proven and listed.", PlacementRequest.show, ge=1, le=50)
    ] = PlacementRequest.show


class SearchProgress(ResponseBody):
    """The progress of a search."""

    done: Annotated[int, told("Number of placements looked at.", 1200)]
    total: Annotated[int, told("Number of placements in all.", 5832)]


class SelectionAsked(RequestBody):
    """Options for choosing calibration poses in the cell of this service; each may be left out."""

    count: Annotated[int, told("Number of poses to select.", 50, ge=1, le=2000)] = 50
    candidates: Annotated[int, told("Number of candidates, drawn at random.", 5000, ge=1, le=50_000)] = 5000
    groups: Annotated[
        list[Annotated[str, Field(max_length=100)]],
        told("What the model will free.", list(DEFAULT_GROUPS), max_length=50),
    ] = Field(default_factory=lambda: list(DEFAULT_GROUPS))
    targets: Annotated[
        list[Annotated[str, Field(max_length=100)]],
        told("Names of targets measured at every pose; left out: all of the cell.", ["T1"], max_length=50),
    ] = Field(default_factory=list)
    offset_deg: Annotated[
        float,
        told("From where every joint arrives, deg.", -5.0, ge=-30.0, le=30.0, allow_inf_nan=False),
    ] = -5.0
    share: Annotated[
        float,
        told("Share of the poses that may fill the joints' ranges.", SHARE, ge=0.0, le=1.0),
    ] = SHARE
    wanted_u_mm: Annotated[
        float,
        told_limit("The required predicted U", 0.1),
    ] = 0.0
    seed: Annotated[int, told("Draws the candidates and the starts; no unit.", 1, ge=0, le=2**53)] = 1
    prior: Prior = Field(default_factory=dict)


JobKind = Literal[
    "identification", "diagnosis", "alignment", "regression", "validation", "selection", "placement", "watch_plan",
    "watch", "upkeep", "sweeps",
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
    | SweepsResult
)


class StoredJob(ResponseBody):
    """A job with its request."""

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


class ProblemKept(ResponseBody):
    """The kept reason why a job could not be done."""

    text: Annotated[str, told("What happened.", "The robot and the points do not belong together.")]
    do: Annotated[str, told("What to do.", "Look at line 12.")]


class _Job(StoredJob):
    state: Annotated[State, told("ready: it waits for its turn; running, succeeded or failed.", "succeeded")]
    state_code: StateCode
    version: Annotated[int, told("1 ready, 2 running, 3 over; no unit. Ask with `after=2` for the end.", 3)]
    problem: Annotated[ProblemShown | None, told("Once it has failed.", None)]
    step: Annotated[str, told("What it does now, in words; empty where it does not say.", "reading")] = ""
    report: Annotated[
        str | None, told("The path of its report.", "/api/v1/reports/20261121-170459-3f9a1c07b2e")
    ]


class JobResponse(_Job):
    """A job of any kind; `result` once it has succeeded, `problem` once it has failed."""

    result: Annotated[Result | None, told("Once it has succeeded; `format` says which it is.", None)]


class ResultShown(ResponseBody):
    """Members of all results. Those of jobs have the members of a job besides, those of loops the members of a loop."""

    id: Annotated[str, told("The id of the job, loop or verification.", "20261122-143851-6ab9e645236")]
    kind: Annotated[
        str, told("identification, diagnosis, regression, alignment, loop or verification.", "diagnosis")
    ]
    state: Annotated[str, told("The state, as of a run.", "succeeded")]
    version: Annotated[int, told("A number that grows with everything that happens.", 3)]
    created_utc: Annotated[str, told("When it was asked for, RFC 3339.", "2026-11-22T14:43:01.512Z")]
    report: Annotated[str | None, told("Path of the report; null before there is one.", None)]


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
    """A regression compared with the models of a data set."""

    result: Annotated[RegressionResult | None, told("Once it has succeeded.", None)]


class ValidationShown(_Job):
    """A validation."""

    result: Annotated[ValidationResult | None, told("Once it has succeeded.", None)]


class SweepsShown(_Job):
    """The sweeps of a data set."""

    result: Annotated[SweepsResult | None, told("Once it has succeeded.", None)]


class SelectionShown(_Job):
    """A selection of poses."""

    result: Annotated[SelectionResult | None, told("Once it has succeeded.", None)]


class PlacementsShown(_Job):
    """A search of placements."""

    progress: Annotated[SearchProgress | None, told("How far it is, once it has begun.", None)] = None
    result: Annotated[PlacementsResult | None, told("Once it has succeeded.", None)]


class BaselineShown(ResponseBody):
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
    """A thermal update."""

    result: Annotated[UpkeepResult | None, told("Once it has succeeded.", None)]


class WatchPlansShown(ResponseBody):
    """Plans of watches."""

    watch_plans: Annotated[list[WatchPlanShown], told("Newest first.", [])]


class WatchesShown(ResponseBody):
    """Watches."""

    watches: Annotated[list[WatchShown], told("Newest first.", [])]


class UpkeepsShown(ResponseBody):
    """Thermal updates."""

    upkeeps: Annotated[list[UpkeepShown], told("Newest first.", [])]


class JobsShown(ResponseBody):
    """The jobs of a data set."""

    jobs: Annotated[list[JobResponse], told("Newest first.", [])]
