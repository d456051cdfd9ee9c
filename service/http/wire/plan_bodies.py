"""The answers about plans, prices, scenes and errors in space, as OpenAPI describes them.

Lengths mm, world frame; angles deg, as the controller counts them; times s of the campaign.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from service.http.wire.bodies import ResponseBody


def _field(description: str, example: Any) -> Any:
    """A field with its description, its unit and an example."""
    return Field(description=description, examples=[example])


_POINT = [412.3, -120.5, 655.0]
Place = Annotated[list[float], _field("x, y, z in the world frame, mm.", _POINT)]
Format = Annotated[str, _field("Name of this format.", "truepose-plan/1")]
VisitNumber = Annotated[int, _field("Number of the visit in the plan, from 0 on.", 17)]


class PlannedShown(ResponseBody):
    """One planned reading."""

    id: Annotated[int | None, _field("Number of the planned reading in the record; null of a dry run.", 52)]
    target: Annotated[str, _field("The target on the tool, or the nest.", "T1")]
    base_target: Annotated[
        str | None, _field("Of a distance: the ball to which it is measured; else null.", "B1")
    ]
    status: Annotated[str, _field("planned, deferred, measured or skipped.", "measured")]
    expected_mm: Annotated[
        list[float] | None, _field("Where the nominal robot has the target, mm; null of a nest.", _POINT)
    ]


class VisitShown(ResponseBody):
    """The robot at rest in one pose once."""

    number: VisitNumber
    name: Annotated[
        str, _field("The name by which people are told of it.", "pose 9 of block 1 (calibration)")
    ]
    kind: Annotated[str, _field("pose, or nest where the arm takes no part.", "pose")]
    set: Annotated[str, _field("calibration, validation, reference, repeat or nest.", "calibration")]
    joints_deg: Annotated[
        list[float], _field("Joint angles, deg; empty of a nest.", [0.0, 20.0, -30.0, 0.0, 45.0, 0.0])
    ]
    seconds: Annotated[
        float | None, _field("What its path, settling and readings take, s; null of a nest.", 17.9)
    ]
    readings: Annotated[list[PlannedShown], _field("Its readings, in the order of the plan.", [])]


class PlanShown(ResponseBody):
    """A plan with what became of it so far."""

    format: Format
    visits: Annotated[list[VisitShown], _field("Every visit, in the order of the plan.", [])]
    path_mm: Annotated[
        list[list[float]], _field("The path of the first target of the tool, as points, mm.", [_POINT])
    ]
    detours: Annotated[
        int | None, _field("The number of paths over home, in a dry run of at most 400 poses; else null.", 8)
    ]
    seconds: Annotated[float, _field("What the whole plan takes, s.", 5413.5)]
    noise_mm: Annotated[
        float | None,
        _field("By how much two readings of one target may differ, k = 2, mm; null of a ballbar.", 0.065),
    ] = None
    expected_within_mm: Annotated[
        float | None,
        _field("A reading farther from where it is expected is taken for another target, mm.", 15.0),
    ] = None


class UncertaintyResponse(ResponseBody):
    """Expanded uncertainty of predicted positions over the joint limits of the cell, k = 2, worst direction."""

    median: Annotated[float, _field("In the middle of all postures, mm.", 0.031)]
    p95: Annotated[float, _field("Not exceeded in 95 of 100 postures, mm.", 0.052)]
    max: Annotated[float, _field("In the worst posture, mm.", 0.071)]


class PriceShown(ResponseBody):
    """The price of a visit."""

    format: Annotated[str, _field("Name of this format.", "truepose-price/1")]
    visit: VisitNumber
    name: Annotated[str, _field("The name of the visit.", "pose 9 of block 1 (calibration)")]
    set: Annotated[str, _field("The set of its readings; validation only judges.", "calibration")]
    seconds: Annotated[float, _field("What it takes to measure it again, s.", 17.9)]
    coverage_factor: Annotated[int, _field("k of the uncertainties, a number.", 2)]
    u_mm: Annotated[
        UncertaintyResponse | None,
        _field(
            "Predicted U as planned, and with the visit measured again, mm; null where it cannot be said.", {}
        ),
    ]
    u_without_mm: Annotated[
        UncertaintyResponse | None,
        _field("Predicted U without the visit, mm; null where it cannot be said.", {}),
    ]


class ArrowShown(ResponseBody):
    """A reading with its error, measured less predicted."""

    reading: Annotated[str, _field("Id of the reading in its data set.", "17")]
    at_mm: Place
    nominal_mm: Annotated[
        list[float], _field("Its error by the nominal robot in its place, mm.", [0.4, -0.9, 0.3])
    ]
    model_mm: Annotated[list[float], _field("Its error by the model found, mm.", [0.01, -0.02, 0.01])]


class ArrowsShown(ResponseBody):
    """Errors in space."""

    format: Annotated[str, _field("Name of this format.", "truepose-arrows/1")]
    held_out: Annotated[bool, _field("Whether nothing was fitted to these readings.", True)]
    readings: Annotated[int, _field("The number of readings of which these are a draw.", 120)]
    arrows: Annotated[list[ArrowShown], _field("At most 500 of them.", [])]


class ResultShown(ResponseBody):
    """Members of all results. Those of jobs have the members of a job besides, those of loops the members of a loop."""

    id: Annotated[str, _field("The id of the job or loop.", "20261122-143851-6ab9e645236")]
    kind: Annotated[str, _field("identification, diagnosis, regression, alignment or loop.", "diagnosis")]
    state: Annotated[str, _field("The state, as of a run.", "succeeded")]
    version: Annotated[int, _field("A number that grows with everything that happens.", 3)]
    created_utc: Annotated[str, _field("When it was asked for, RFC 3339.", "2026-11-22T14:43:01.512Z")]
    report: Annotated[str | None, _field("Path of the report; null before there is one.", None)]


class CapsuleShown(ResponseBody):
    """A part of arm or tool: all points within a radius of a line."""

    name: Annotated[str, _field("The part.", "forearm")]
    link: Annotated[int, _field("Number of the link with which it moves, from 1 on.", 4)]
    from_mm: Place
    to_mm: Place
    radius_mm: Annotated[float, _field("Its radius, mm.", 65.0)]


class ObstacleShown(ResponseBody):
    """An obstacle of arm and tool: a table has a height, a box two corners, a post two ends and a radius."""

    kind: Annotated[str, _field("table, box or post.", "box")]
    name: Annotated[str, _field("Its name in the cell file.", "keep-out box 1")]


class SceneShown(ResponseBody):
    """A cell as a picture needs it."""

    format: Annotated[str, _field("Name of this format.", "truepose-scene/1")]
    joints_deg: Annotated[
        list[float], _field("The posture that is shown, deg.", [0.0, 20.0, -30.0, 0.0, 45.0, 0.0])
    ]
    limits_deg: Annotated[
        list[list[float]], _field("Lowest and highest angle of every joint, deg.", [[-90.0, 90.0]])
    ]
    capsules: Annotated[list[CapsuleShown], _field("Arm and tool in that posture.", [])]
    obstacles: Annotated[list[ObstacleShown], _field("Table, boxes and posts.", [])]
    nests_mm: Annotated[
        dict[str, list[float]],
        _field("Where the nests, or balls on the base, are, mm.", {"N1": [0.0, 0.0, 0.0]}),
    ]
    targets_mm: Annotated[
        dict[str, list[float]],
        _field("Where the targets of the tool are in that posture, mm.", {"T1": _POINT}),
    ]
    tool_mm: Annotated[
        dict[str, list[float]], _field("The targets in the flange frame, mm.", {"T1": [0.0, 0.0, 125.0]})
    ]
    station_mm: Annotated[
        list[float] | None,
        _field("Where the instrument stands, mm; null of a ballbar.", [2400.0, -900.0, 350.0]),
    ]
    bar_mm: Annotated[float | None, _field("Length of the ballbar, mm; null of other instruments.", 300.0)]
    one_smr: Annotated[bool, _field("Whether a person moves the only SMR.", False)]
