"""The bodies of requests and answers, as OpenAPI describes it.

Requests are strict: `dry_run` is a boolean and nothing that resembles one, because it decides whether a robot
moves. Fields that are not given are left out rather than null, which client generators handle best.
"""

from __future__ import annotations

from typing import Annotated, Any, Self

from fastapi import Body as BodyOf
from pydantic import BaseModel, ConfigDict, Field, model_validator

from acquisition import State
from calib.compensate import Bounds

Name = Annotated[str, Field(max_length=200)]


class Body(BaseModel):
    """A request."""

    model_config = ConfigDict(strict=True, extra="forbid")


class NewRun(Body):
    """One of `campaign` and `campaign_id`. `dry_run` true: everything is checked and nothing moves."""

    campaign: dict[str, Any] = Field(default_factory=dict, description="As in campaign.toml.")
    campaign_id: Name = ""
    dry_run: bool = True
    name: Name = ""

    @model_validator(mode="after")
    def _one_campaign(self) -> NewRun:
        if bool(self.campaign) == bool(self.campaign_id):
            raise ValueError("give either campaign or campaign_id")
        return self


class NewCampaign(Body):
    """A campaign to be kept."""

    campaign: dict[str, Any] = Field(min_length=1, description="As in campaign.toml.")
    name: Name = ""


class TakeLease(Body):
    """`seconds` until the lease expires unless this is sent again with its `Lease-Id`."""

    holder: Annotated[str, Field(min_length=1, max_length=200)]
    seconds: Annotated[float, Field(ge=1.0, le=300.0, allow_inf_nan=False, strict=False)] = 30.0


class TakeLeaseOver(TakeLease):
    """`reason`: why the lease is taken from whoever holds it; it is kept."""

    reason: Annotated[str, Field(min_length=1, max_length=500, pattern=r"\S")]


class NewLoop(NewRun):
    """The request for a closed loop: that of a run, and how many new poses shall verify the correction."""

    poses: Annotated[int, Field(ge=1, le=500)] = 20


class Why(Body):
    """The name or reason that a person gives with an order; may be left out."""

    reason: Annotated[str, Field(max_length=500)] = ""


class Resume(Body):
    """May be left out. `accept_other`: the serial number of another robot or instrument than the record's, with the
    `reason` for which both belong together."""

    accept_other: Name = ""
    reason: Annotated[str, Field(max_length=500)] = ""

    @model_validator(mode="after")
    def _both(self) -> Self:
        if bool(self.accept_other.strip()) != bool(self.reason.strip()):
            raise ValueError("give both accept_other and reason, or none")
        return self


class Export(Resume):
    """May be left out. `with`: ids of runs measured later in the same cell, brought into one data set."""

    later: Annotated[list[Name], Field(max_length=100, alias="with")] = Field(default_factory=list)
    name: Name = ""


ResumeBody = Annotated[Resume, BodyOf(default_factory=Resume)]
WhyBody = Annotated[Why, BodyOf(default_factory=Why)]
ExportBody = Annotated[Export, BodyOf(default_factory=Export)]


class TargetsToCorrect(Body):
    """One of `csv` and `targets`: joint angles `j1_deg` ..., or poses `x_mm` ... `rot_z` with their `config`."""

    csv: Annotated[str, Field(max_length=1_000_000, description="As in TARGETS.csv.")] = ""
    targets: Annotated[list[dict[str, Any]], Field(max_length=50_000)] = Field(default_factory=list)
    conditions: Annotated[str, Field(max_length=1000)] = Field(
        default="", description="KEY=VALUE,...: side, approach, temperature, time, mass, cog, series."
    )
    tool: Annotated[str, Field(max_length=200)] = Field(
        default="", description="x,y,z,w,p,r of the tool that poses are meant for, mm and deg."
    )
    inverse: bool = Field(default=False, description="From actual to nominal: taught on the real robot.")
    keep_refused: bool = False
    largest_deg: Annotated[float, Field(gt=0.0, le=90.0, strict=False)] = Field(
        default=Bounds().turn_deg, description="A model that turns the flange by more is refused."
    )
    largest_mm: Annotated[float, Field(gt=0.0, le=1000.0, strict=False)] = Field(
        default=Bounds().shift_mm, description="A model that shifts the flange by more is refused."
    )

    @model_validator(mode="after")
    def _one_table(self) -> TargetsToCorrect:
        if bool(self.csv) == bool(self.targets):
            raise ValueError("give either csv or targets")
        return self


class OfDataset(Body):
    """Readings to work on."""

    dataset_id: Annotated[str, Field(min_length=1, max_length=200)]


class Answered(BaseModel):
    """A response; members may be added in time."""

    model_config = ConfigDict(extra="allow")


class PromptShown(Answered):
    """A question to a person; `expects`: the answers that can be given."""

    id: str
    text: str
    picture: str | None
    expects: list[str]


class RunShown(Answered):
    """A run. `version` grows with everything that happens to it."""

    id: str
    name: str
    state: str
    state_code: int
    reason: str
    version: int
    done: int
    total: int
    skipped: int
    prompt: PromptShown | None
    last_reading: dict[str, Any] | None
    seconds_left: float | None
    drift: dict[str, Any] | None = None
    simulated: bool
    dry_run: bool
    damaged: bool = False
    error: dict[str, Any] | None


class LoopKept(Answered):
    """The kept document of a closed loop: what every file of one must hold."""

    id: str
    name: str
    state: State
    version: int
    runs: list[str]
    run_id: str | None
    dry_run: bool


class LoopShown(Answered):
    """A closed loop. `step`: what it does now; `run`: that of `runs` which is in hand; `result`: once it is through."""

    id: str
    name: str
    created_utc: str
    state: str
    state_code: int
    reason: str
    version: int
    step: str
    steps: list[str]
    runs: list[str]
    run_id: str | None
    run: RunShown | None
    dataset_id: str | None
    dry_run: bool
    simulated: bool
    problem: dict[str, Any] | None
    result: dict[str, Any] | None
    report: str | None


class CorrectedTargets(Answered):
    """Corrected targets, as `csv` and as `rows`, and what became of each (`truepose-compensation/1`)."""

    format: str
    model: str
    robot: str
    direction: str
    conditions: dict[str, Any]
    corrected: int
    refused: int
    empty: int
    largest_move_mm: float | None
    largest_quantisation_mm: float | None
    targets: list[dict[str, Any]]
    warnings: list[str]
    csv: str
    rows: list[dict[str, Any]]


class LeaseShown(Answered):
    """The motion lease; `lease_id` is its secret, given in the answer that grants it and empty ever after."""

    holder: str
    expires_utc: str
    seconds: float
    lease_id: str = ""
    taken_from: str = ""


class CellShown(Answered):
    """The cell of this service."""

    name: str
    robot: str
    robot_driver: str
    instrument: str
    instrument_driver: str
    targets: list[str]
    nests: list[str]
    simulated: bool
    run_id: str | None
    loop_id: str | None
    role: str
    lease: LeaseShown | None


class CampaignShown(Answered):
    """A campaign that was kept."""

    id: str
    name: str
    created_utc: str
    campaign: dict[str, Any]


class DatasetShown(Answered):
    """A data set; `fit` and `validation`: how many readings take part in which."""

    id: str
    name: str
    created_utc: str
    run_id: str | None
    simulated: bool
    sha256: str
    robot: str
    instrument: str
    readings: int
    fit: int
    validation: int


class JobKept(Answered):
    """A job of any kind as it was asked for."""

    id: str
    kind: str
    dataset_id: str
    created_utc: str


class ProblemKept(Answered):
    """The kept reason why a job could not be done."""

    text: str
    do: str


class JobShown(Answered):
    """A job of any kind; `result` once it has succeeded, `problem` once it has failed.

    `dataset_id`: of an alignment, the data set it made, empty before. `progress`: of a search of placements, how many
    are `done` of the `total`.
    """

    id: str
    kind: str
    dataset_id: str
    created_utc: str
    state: str
    state_code: int
    version: int
    result: dict[str, Any] | None
    problem: dict[str, Any] | None
    report: str | None


class JobsShown(Answered):
    """The jobs of a data set."""

    jobs: list[JobShown]


class Health(Answered):
    """The service answers."""

    status: str
    version: str
    simulated: bool


class Runs(Answered):
    runs: list[RunShown]


class Loops(Answered):
    loops: list[LoopShown]


class Prompts(Answered):
    prompts: list[PromptShown]


class Campaigns(Answered):
    campaigns: list[CampaignShown]


class Datasets(Answered):
    datasets: list[DatasetShown]


class ProblemShown(Answered):
    """RFC 9457, with a sentence on what happened and one on what to do."""

    type: str
    title: str
    status: int
    detail: str
    code: int
    operator_text: str
    what_to_do: str
