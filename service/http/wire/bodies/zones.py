"""The zones that a result is held to, as a request has them: those of `--accept-zones`."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from service.http.wire.bodies.told import Body, told, told_limit
from service.results.judgement.zones import FARTHEST, Zone

_LOW, _HIGH = [200.0, -400.0, 0.0], [500.0, -100.0, 300.0]
_MOST = 100
_COORDINATE = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST, allow_inf_nan=False)]


class ZoneAsked(Body):
    """A box with edges along the axes of the robot's base frame, and the largest errors in it, one of them or both."""

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
