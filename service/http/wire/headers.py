"""Headers and query parameters that several routes share."""

from __future__ import annotations

from typing import Annotated

from fastapi import Header, Query

IdempotencyKey = Annotated[
    str,
    Header(
        alias="Idempotency-Key",
        max_length=200,
        description="Sent again with the same request, nothing is done twice.",
    ),
]
LeaseId = Annotated[
    str,
    Header(
        alias="Lease-Id",
        max_length=200,
        description="`lease_id` of the motion lease: the secret that the answer which granted it held, once. Whatever "
        "moves the robot needs it, and so does prolonging the lease and giving it back.",
    ),
]
Wait = Annotated[int, Query(ge=0, le=60, description="Seconds to wait for a version beyond `after`.")]
After = Annotated[int, Query(ge=0, le=2**53, description="The version that is known already.")]
