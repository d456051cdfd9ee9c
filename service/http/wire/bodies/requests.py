"""The bodies of requests.

They are strict: `dry_run` is a boolean and nothing that resembles one, because it decides whether a robot moves.
Fields that are not given are left out rather than null, which client generators handle best.

They include the zones with limits of the error, as in the file of `--accept-zones`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from fastapi import Body as BodyOf
from pydantic import AfterValidator, ConfigDict, Field, field_validator, model_validator

from calib.compensate import Bounds
from service.http.wire.bodies.fields import AsRead, Name, Prior, RequestBody, told, told_limit
from service.http.wire.bodies.targets import TargetRow
from service.results.common import Campaign
from service.results.judgement.acceptance import FARTHEST, AcceptanceLimits, Zone
from service.results.shape import DescribedAs

_LOW, _HIGH = [200.0, -400.0, 0.0], [500.0, -100.0, 300.0]
_MOST = 100
_COORDINATE = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST, allow_inf_nan=False)]


class ZoneAsked(RequestBody):
    """A box along the axes of the robot's base frame, with one or two limits of the error in it."""

    name: Annotated[
        str,
        told("Its name, as the verdict has it.", "left table", min_length=1, max_length=200, pattern=r"\S"),
    ]
    low_mm: Annotated[
        list[_COORDINATE],
        told("Its lowest corner x, y, z in the base frame, mm.", _LOW, min_length=3, max_length=3),
    ]
    high_mm: Annotated[
        list[_COORDINATE],
        told("Its highest corner x, y, z in the base frame, mm.", _HIGH, min_length=3, max_length=3),
    ]
    accept_rms_mm: Annotated[
        float,
        told_limit("Limit of the RMS error in it", 0.1),
    ] = 0.0
    accept_max_mm: Annotated[
        float,
        told_limit("Limit of the largest error in it", 0.25),
    ] = 0.0

    @model_validator(mode="after")
    def _a_box_with_a_limit(self) -> Self:
        if not all(a < b for a, b in zip(self.low_mm, self.high_mm, strict=True)):
            raise ValueError("high_mm is not above low_mm on every axis")
        if not (self.accept_rms_mm or self.accept_max_mm):
            raise ValueError("give accept_rms_mm, accept_max_mm or both")
        return self

    @property
    def zone(self) -> Zone:
        """The zone as the judgement has it."""
        (a, b, c), (d, e, f) = self.low_mm, self.high_mm
        return Zone(self.name, (a, b, c), (d, e, f), self.accept_rms_mm or None, self.accept_max_mm or None)


def _named_apart(zones: list[ZoneAsked]) -> list[ZoneAsked]:
    if len({each.name for each in zones}) < len(zones):
        raise ValueError("two zones have one name")
    return zones


AcceptZones = Annotated[
    list[ZoneAsked],
    AfterValidator(_named_apart),
    told(
        "Parts of the workspace with limits of their own, mm, judged one by one beside the other limits or alone; one "
        "in which no reading held out lies is not decided.",
        [{"name": "left table", "low_mm": _LOW, "high_mm": _HIGH, "accept_rms_mm": 0.1}],
        max_length=_MOST,
    ),
]

SerialNumber = Annotated[
    str,
    told("The serial number of another robot or instrument than the record's.", "120-500321", max_length=200),
]

Reason = Annotated[str, told("Why; it is kept.", "the motor of joint 4 was changed", max_length=500), AsRead]
Given = Annotated[Name, AsRead]

CAMPAIGN = {
    "format": "truepose-campaign/1",
    "block": [
        {"kind": "poses", "set": "calibration", "count": 60, "approach": {"sides": "both"}},
        {"kind": "poses", "set": "validation", "count": 40},
    ],
}

TABLE = "target_id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\nA,10,-20,30,0,45,0\n"
_CAMPAIGN_ID = "20261121-170459-3f9a1c07b2e"


class NewRun(RequestBody):
    """A campaign to measure, given by one of `campaign` and `campaign_id`.

    If `dry_run` is true, everything is checked and nothing moves.
    """

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"campaign": CAMPAIGN, "dry_run": True, "name": "night 1"}]}
    )

    campaign: Annotated[Campaign, told("The campaign itself.", CAMPAIGN)] = Field(default_factory=dict)
    campaign_id: Annotated[str, told("The id of a campaign that was kept.", _CAMPAIGN_ID, max_length=200)] = (
        ""
    )
    dry_run: Annotated[bool, told("True: check everything, move nothing. False: the robot moves.", True)] = (
        True
    )
    name: Given = ""

    @model_validator(mode="after")
    def _one_campaign(self) -> NewRun:
        if bool(self.campaign) == bool(self.campaign_id):
            raise ValueError("give either campaign or campaign_id")
        return self


class NewCampaign(RequestBody):
    """A campaign to be kept."""

    campaign: Annotated[
        Campaign,
        told("The campaign itself.", CAMPAIGN, min_length=1),
    ]
    name: Given = ""


class LeaseRequest(RequestBody):
    """`seconds` until the lease expires unless this is sent again with its `Lease-Id`."""

    holder: Annotated[
        str, told("Who is there, as others will read it.", "anna", min_length=1, max_length=200), AsRead
    ]
    seconds: Annotated[
        float,
        told(
            "Until the lease expires unless it is prolonged, s. Prolong it three times as often.",
            30.0,
            ge=1.0,
            le=300.0,
            allow_inf_nan=False,
        ),
    ] = 30.0


class LeaseTakeoverRequest(LeaseRequest):
    """A request to take the lease from its holder."""

    reason: Annotated[
        str,
        told(
            "Why it is taken; it is kept.", "anna has gone home", min_length=1, max_length=500, pattern=r"\S"
        ),
        AsRead,
    ]


class NewLoop(NewRun):
    """A closed loop: the request for a run, and the number of poses to verify the correction.

    With `accuracy_mm` in place of a campaign the poses are chosen while they are measured, until the accuracy is
    reached; the loop then rests before it drives corrected targets, until a person resumes it.
    """

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"accuracy_mm": 0.1, "minutes": 30.0, "dry_run": True, "poses": 10}]}
    )

    poses: Annotated[int, told("Number of new poses that verify the correction.", 20, ge=1, le=500)] = 20
    accuracy_mm: Annotated[
        float,
        told(
            "RMS error of a reading in the zone, to be reached with 95 % confidence, mm; 0: a campaign is given.",
            0.1,
            ge=0.0,
            le=100.0,
        ),
    ] = 0.0
    minutes: Annotated[
        float, told("Time at the cell, verification included, min; 0: no limit.", 30.0, ge=0.0, le=10_000.0)
    ] = 0.0
    zone: Annotated[
        dict[
            Literal["x_mm", "y_mm", "z_mm"], Annotated[list[_COORDINATE], Field(min_length=2, max_length=2)]
        ],
        told(
            "Box in the world in which the robot works, mm; empty: the workspace.", {"x_mm": [300.0, 550.0]}
        ),
    ] = Field(default_factory=dict)
    zone_joints_deg: Annotated[
        list[Annotated[list[_COORDINATE], Field(min_length=1, max_length=20)]],
        told(
            "Poses at which the robot works, in place of a box, deg.",
            [[12.0, 45.0, -10.0, 80.0, -35.0, 10.0]],
            max_length=10_000,
        ),
    ] = Field(default_factory=list)

    @model_validator(mode="after")
    def _one_campaign(self) -> NewLoop:
        if sum(map(bool, (self.campaign, self.campaign_id, self.accuracy_mm))) != 1:
            raise ValueError("give one of accuracy_mm, campaign and campaign_id")
        if not self.accuracy_mm and (self.minutes or self.zone or self.zone_joints_deg):
            raise ValueError("minutes, zone and zone_joints_deg go with accuracy_mm")
        return self


class NewVerification(RequestBody):
    """The proof of a model on the robot, given by one of `model_id` and `model`.

    If `dry_run` is true, everything is checked and nothing moves.
    """

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"model_id": _CAMPAIGN_ID, "poses": 10, "dry_run": True}]}
    )

    model_id: Annotated[
        str,
        told("The id of the model: that of its job or loop.", _CAMPAIGN_ID, max_length=200),
    ] = ""
    model: Annotated[
        dict[str, Any], told("The model itself, as its file holds it (`truepose-model/1`).", {})
    ] = Field(default_factory=dict)
    poses: Annotated[
        int, told("Number of new poses, each driven corrected and uncorrected.", 10, ge=1, le=500)
    ] = 10
    seed: Annotated[int, told("Number from which the poses are drawn; no unit.", 1, ge=0, le=2**31)] = 1
    dry_run: Annotated[bool, told("True: check everything, move nothing. False: the robot moves.", True)] = (
        True
    )
    name: Given = ""

    @model_validator(mode="after")
    def _one_model(self) -> Self:
        if bool(self.model) == bool(self.model_id):
            raise ValueError("give either model_id or model")
        return self


class ReasonBody(RequestBody):
    """The name or reason that a person gives with an order; may be left out."""

    reason: Reason = ""


class AnswerGiven(ReasonBody):
    """The reason and the typed numbers of an answer; may be left out.

    The numbers are for a prompt with an `entry`.
    """

    typed: Annotated[
        str,
        told("The numbers as the display shows them, where the prompt has an `entry`.", "", max_length=2000),
    ] = ""


class Resume(RequestBody):
    """The replacement of a device that a run accepts; may be left out.

    `accept_other` goes with the `reason` for which both devices belong together.
    """

    accept_other: SerialNumber = ""
    reason: Reason = ""

    @model_validator(mode="after")
    def _both(self) -> Self:
        if bool(self.accept_other.strip()) != bool(self.reason.strip()):
            raise ValueError("give both accept_other and reason, or none")
        return self


class DatasetExportRequest(Resume):
    """Options of an export to a data set; may be left out.

    `with` lists the ids of runs measured later in the same cell, which are combined into one data set.
    """

    later: Annotated[
        list[Annotated[str, Field(max_length=200)]],
        told("Ids of runs measured later in the same cell.", [_CAMPAIGN_ID], max_length=100, alias="with"),
    ] = Field(default_factory=list)
    name: Given = ""


ResumeBody = Annotated[Resume, BodyOf(default_factory=Resume)]
WhyBody = Annotated[ReasonBody, BodyOf(default_factory=ReasonBody)]
AnswerBody = Annotated[AnswerGiven, BodyOf(default_factory=AnswerGiven)]
ExportBody = Annotated[DatasetExportRequest, BodyOf(default_factory=DatasetExportRequest)]

LargestDeg = Annotated[
    float, told("A model that turns the flange by more is refused, deg.", 2.0, gt=0.0, le=90.0)
]

LargestMm = Annotated[
    float,
    told("A model that shifts the flange by more is refused, mm.", 15.0, gt=0.0, le=1000.0),
]

Conditions = Annotated[
    str,
    told(
        "For which conditions it shall hold, KEY=VALUE,...: side, approach (deg), temperature (degC), time (s), mass "
        "(kg), cog (mm), series. What is left out is that of the model.",
        "side=below,temperature=23.5",
        max_length=1000,
    ),
]

Inverse = Annotated[bool, told("From actual to nominal: targets taught on the real robot.", False)]
KeepRefused = Annotated[bool, told("Go on though some targets stay as they were.", False)]


class TargetsToCorrect(RequestBody):
    """One of `csv` and `targets`."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"csv": TABLE, "conditions": "side=below"}]})

    csv: Annotated[
        str,
        told(
            "The table as text, with units in its column names (deg, mm).",
            TABLE,
            max_length=1_000_000,
        ),
    ] = ""
    targets: Annotated[
        list[Annotated[dict[str, Any], DescribedAs(TargetRow)]],
        told("The table as rows.", [{"target_id": "A", "j1_deg": 10.0}], max_length=50_000),
    ] = Field(default_factory=list)
    conditions: Conditions = ""
    tool: Annotated[
        str,
        told(
            "x,y,z,w,p,r of the tool that poses are meant for, mm and deg.", "0,0,100,0,0,0", max_length=200
        ),
    ] = ""
    inverse: Inverse = False
    keep_refused: KeepRefused = False
    named_only: Annotated[
        bool, told("Leave out the carried terms of the model: correct named causes only.", False)
    ] = False
    most_uncertainty_mm: Annotated[
        float, told_limit("Refuse targets that the model knows less well than this (95 %)", 0.2)
    ] = 0.0
    largest_deg: LargestDeg = Bounds().turn_deg
    largest_mm: LargestMm = Bounds().shift_mm

    @model_validator(mode="after")
    def _one_table(self) -> TargetsToCorrect:
        if bool(self.csv) == bool(self.targets):
            raise ValueError("give either csv or targets")
        return self


DatasetId = Annotated[
    str, told("The id of the readings.", "20261121-170459-3f9a1c07b2e", min_length=1, max_length=200)
]

AcceptRms = Annotated[
    float,
    told_limit(
        "Limit of the RMS error on readings held out", 0.05, " The verdict is in `result.acceptance`."
    ),
]

AcceptMax = Annotated[
    float,
    told_limit("Limit of the largest error on readings held out", 0.15),
]


Level = Annotated[
    int, told("1 joints, 2 geometry, 3 and gravity; 0: what the header frees; no unit.", 0, ge=0, le=3)
]


class DatasetReference(RequestBody):
    """Readings to work on."""

    dataset_id: DatasetId


class JudgeRequest(DatasetReference):
    """Readings to work on, and limits of the error of the result."""

    accept_rms_mm: AcceptRms = 0.0
    accept_max_mm: AcceptMax = 0.0
    accept_zones: AcceptZones = Field(default_factory=list)

    @property
    def limits(self) -> AcceptanceLimits | None:
        """The requested limits; None if none were requested."""
        zones = [each.zone for each in self.accept_zones]
        return AcceptanceLimits.of(self.accept_rms_mm or None, self.accept_max_mm or None, zones)


class ValidationAsked(JudgeRequest):
    """A data set, and the model to judge on it; without a model kinds of hold-out are compared."""

    model_id: Annotated[
        str,
        told(
            "The id of the model (that of its job); left out: hold-outs.",
            "20261121-170459-3f9a1c07b2e",
            max_length=200,
        ),
    ] = ""
    place: Annotated[
        bool,
        told(
            "Fit base, and tool where the model frees it, to the calibration rows, or without any to all. Of "
            "distances: the balls, by half of the poses where all rows judge.",
            False,
        ),
    ] = False
    everything: Annotated[
        bool, told("Judge on all measured rows, not on those alone that only judge.", False)
    ] = False
    compare_id: Annotated[
        str,
        told(
            "The id of another calibration of the same robot to compare the model with; left out: none.",
            "20261121-181210-5b0c2d18c3f",
            max_length=200,
        ),
    ] = ""
    point: Annotated[
        list[_COORDINATE],
        told(
            "A point x, y, z of the world, mm: errors are also grouped by the distance from it; empty: none.",
            [300.0, 0.0, 400.0],
            max_length=3,
        ),
    ] = Field(default_factory=list)

    @field_validator("point")
    @classmethod
    def _three(cls, point: list[float]) -> list[float]:
        if len(point) not in (0, 3):
            raise ValueError("three numbers x, y, z are needed")
        return point


class ToFit(JudgeRequest):
    """Readings to fit a model to, and limits of its error."""

    save_anyway: Annotated[
        bool,
        told(
            "Whether the model is kept even if it misses held-out readings by more than the nominal robot does; "
            "otherwise the job fails then.",
            False,
        ),
    ] = False
    prior: Prior = Field(default_factory=dict)

    @property
    def options(self) -> dict[str, Any]:
        """The options of the job except for limits, prior and other data sets."""
        return {"save_anyway": self.save_anyway}


class ToIdentify(ToFit):
    """Readings to identify a robot from."""

    level: Level = 0

    @property
    def options(self) -> dict[str, Any]:
        """The options of the job, including the level."""
        return {**super().options, "level": self.level or None}


class ToDiagnose(ToFit):
    """Readings to diagnose a robot from."""

    most: Annotated[int, told("Number of effects that may be added, at most.", 10, ge=0, le=1000)] = (
        60  # that of `calib.diagnose`, of which the service imports nothing as it starts
    )
    carry_to: Annotated[
        str,
        told("Id of another data set of the robot, to judge the effects on as well.", "", max_length=200),
    ] = ""
    patch: Annotated[bool, told("Map what is left as well: a patch, judged apart, never a cause.", False)] = (
        False
    )

    @property
    def options(self) -> dict[str, Any]:
        """The options of the job, including those of a diagnosis."""
        return {**super().options, "most": self.most, "patch": self.patch}


class SweepsAsked(DatasetReference):
    """A data set with sweeps, and the level of the identification with whose axes theirs are compared."""

    level: Level = 0


class RegressionAsked(DatasetReference):
    """A data set, and the options of `truepose regress`."""

    on: Annotated[Literal["residuals", "positions"], told("What the regression learns.", "residuals")] = (
        "residuals"
    )
    kernel: Annotated[Literal["linear", "rbf"], told("Its kernel.", "linear")] = "linear"
    features: Annotated[
        Literal["closed-form", "printed", "tool-down", "turns"] | None,
        told("Its features; left out: those that suit `on`.", "closed-form"),
    ] = None
    level: Annotated[int, told("Level of the model beside it, 2 or 3; no unit.", 3, ge=2, le=3)] = 3
    compare: Annotated[bool, told("Both ways beside each other.", False)] = False
    diagnose: Annotated[bool, told("Also beside a diagnosis.", False)] = False
