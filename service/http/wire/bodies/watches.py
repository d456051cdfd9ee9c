"""Bodies of watches: requests for check poses, watches and thermal updates.

A plan of check poses has its campaign.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from service.http.wire.bodies.fields import RequestBody, told
from service.results.common import Campaign
from service.results.watch_answers import WatchPlanFound

_ID = "20261121-170459-3f9a1c07b2e"
_HASH = "a93c6fe109b1ae117f0e7f2bb0621db385ac9f84da4fc45fa30a1e73de499bda"
RATE = 0.01
"""The rate of `calib.watch`, which the service loads in its workers alone; a test compares."""
CAMPAIGN = {
    "format": "truepose-campaign/1",
    "block": [{"kind": "poses", "set": "calibration", "select": "list", "joints_deg": [[12.0, 45.0, -10.0]]}],
}
FalseAlarms = Annotated[
    float,
    told(
        "Share of watches of an unchanged robot that raise an alarm, no unit.",
        RATE,
        ge=1e-4,
        le=0.2,
        allow_inf_nan=False,
    ),
]
NewFrame = Annotated[
    bool, told("Fit the frame anew: the instrument stands elsewhere. A moved base is not seen.", False)
]
AllowMissing = Annotated[bool, told("Judge although check poses are missing.", False)]
RunningS = Annotated[
    float,
    told(
        "How long the robot had run, from cold, when the readings began, s; 0: cold; -1: nobody knows, for which a "
        "model that warms up is refused.",
        1800.0,
        ge=-1.0,
        le=1e7,
        allow_inf_nan=False,
    ),
]


class BaselineReference(RequestBody):
    """The model of the calibration, by the id of its job or by the hash of its document.

    The document is in the history.
    """

    model_id: Annotated[str, told("The id of the model (that of its job).", _ID, max_length=200)] = ""
    model_document: Annotated[
        str,
        told("The hash of a model in the history, instead of model_id.", _HASH, pattern="^([0-9a-f]{64})?$"),
    ] = ""

    @model_validator(mode="after")
    def _one(self) -> Any:
        if bool(self.model_id) == bool(self.model_document):
            raise ValueError("give either model_id or model_document")
        return self


class ReadingsReference(BaselineReference):
    """Readings to judge by a baseline: a data set, or a run whose readings are made one."""

    dataset_id: Annotated[str, told("The id of the readings.", _ID, max_length=200)] = ""
    run_id: Annotated[
        str, told("The id of a run of this service, instead of dataset_id.", _ID, max_length=200)
    ] = ""
    false_alarms: FalseAlarms = RATE
    allow_missing: AllowMissing = False
    running_s: RunningS = -1.0

    @model_validator(mode="after")
    def _one_source(self) -> Any:
        if bool(self.dataset_id) == bool(self.run_id):
            raise ValueError("give either dataset_id or run_id")
        return self


class WatchPlanAsked(BaselineReference):
    """Options for choosing check poses in the cell of this service; nothing moves."""

    poses: Annotated[int, told("Number of poses to visit.", 10, ge=1, le=200)] = 10
    targets: Annotated[
        list[Annotated[str, Field(max_length=100)]],
        told("Names of targets measured at every pose; left out: all of the cell.", ["T1"], max_length=50),
    ] = Field(default_factory=list)
    candidates: Annotated[int, told("Number of candidates, drawn at random.", 800, ge=1, le=20_000)] = 800
    offset_deg: Annotated[
        float,
        told("From how far away every joint arrives, deg.", 5.0, ge=0.1, le=30.0, allow_inf_nan=False),
    ] = 5.0
    one_side: Annotated[bool, told("Arrive from below on every joint: play is not seen.", False)] = False
    visits: Annotated[
        Annotated[int, Field(ge=1, le=20)] | None,
        told(
            "Number of visits to each pose, every other time from the opposite sides; null: as few as show every "
            "cause.",
            2,
        ),
    ] = None
    readings: Annotated[
        Annotated[int, Field(ge=1, le=100)] | None,
        told("Number of readings of each target in a visit; null: as few as show every cause.", 6),
    ] = None
    new_frame: NewFrame = False
    false_alarms: FalseAlarms = RATE
    seed: Annotated[int, told("Draws the candidates; no unit.", 1, ge=0, le=2**53)] = 1


class WatchRequestBody(ReadingsReference):
    """Check poses to judge."""

    new_frame: NewFrame = False
    average: Annotated[
        bool,
        told("Average with earlier watches of this service at the same poses against the same model.", True),
    ] = True


class UpkeepAsked(ReadingsReference):
    """A few readings between watches, which show how warm the arm is."""


class WatchPlanResult(WatchPlanFound):
    """Check poses, what they will show, and the campaign that visits them: POST it to /runs."""

    campaign: Annotated[Campaign, told("The campaign of the check poses.", CAMPAIGN)]
