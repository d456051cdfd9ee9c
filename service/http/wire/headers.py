"""Headers, query and path parameters that several routes share."""

from __future__ import annotations

from typing import Annotated

from fastapi import Header, Path, Query

IdempotencyKey = Annotated[
    str,
    Header(
        alias="Idempotency-Key",
        max_length=200,
        description="Sent again with the same request, nothing is done twice: the first answer comes again.",
        examples=["night-1"],
    ),
]
LeaseId = Annotated[
    str,
    Header(
        alias="Lease-Id",
        max_length=200,
        description="`lease_id` of the motion lease: the secret that the answer which granted it held, once. "
        "Requests that move the robot need it, and so do those that prolong or give back the lease.",
        examples=["mB0p2kq8J9yqk0Yd0F3J8V5cQv2m0f1x"],
    ),
]
Wait = Annotated[
    int,
    Query(
        ge=0,
        le=60,
        description="Wait so long for a version beyond `after`, s. With 0, at once.",
        examples=[20],
    ),
]
After = Annotated[
    int, Query(ge=0, le=2**53, description="The version that is known already; no unit.", examples=[412])
]
_ID = ["20261121-170459-3f9a1c07b2e"]
RunId = Annotated[str, Path(description="The id of a run.", examples=_ID)]
VerificationId = Annotated[str, Path(description="The id of a verification.", examples=_ID)]
LoopId = Annotated[str, Path(description="The id of a loop.", examples=_ID)]
CampaignId = Annotated[str, Path(description="The id of a campaign that was kept.", examples=_ID)]
DatasetId = Annotated[str, Path(description="The id of a data set.", examples=_ID)]
JobId = Annotated[str, Path(description="The id of a job, or of a loop where it has a result.", examples=_ID)]
PromptId = Annotated[str, Path(description="The id of the prompt that is open.", examples=["p7"])]
