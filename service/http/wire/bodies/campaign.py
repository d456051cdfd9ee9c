"""The body of a campaign: what `campaign.toml` holds, as JSON. It describes; `acquisition.campaign` reads and refuses.

examples/README.md has the same keys at length. `tests/service/test_openapi.py` holds the reader and these together.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired

from typing_extensions import TypedDict

from service.http.wire.bodies.told import DescribedAs, Joints, told

Set = Annotated[
    Literal["calibration", "validation"],
    told("Calibration enters the fit, validation never does.", "calibration"),
]
Posture = Annotated[list[float], told("The posture, deg; left out: drawn.", [0.0, 20.0, 0.0, 0.0, 60.0, 0.0])]
Step = Annotated[float, told("Step, deg; 5 where it is left out.", 5.0)]
Count = Annotated[int, told("Number of poses that are drawn.", 60)]
Balls = Annotated[list[str], told("Names of balls on the base; left out: the cell's.", ["N1", "N2", "N3"])]
Stages = Annotated[
    Literal[1, 2],
    told("Number of stages, 2 where left out: what lay out of the bar's stroke comes again.", 2),
]


class ApproachTable(TypedDict):
    """How the last move to a pose begins: from an approach point that lies off in every joint."""

    offset_deg: NotRequired[
        Annotated[float, told("How far off every joint starts, deg; -5 where left out.", -5.0)]
    ]
    sides: NotRequired[
        Annotated[
            Literal["one", "both"],
            told("`both`: from a side drawn for each joint of each pose; `one` where left out.", "both"),
        ]
    ]
    longest_deg: NotRequired[
        Annotated[float, told("Up to which the length is drawn anew for each pose, deg.", 15.0)]
    ]


class WarmUpTable(TypedDict):
    """The reference pose is measured until the arm is warm."""

    below_mm: Annotated[float, told("The last readings must lie within this of each other, mm.", 0.02)]
    over: NotRequired[Annotated[int, told("Number of those readings; 3 where left out.", 3)]]
    every_s: NotRequired[Annotated[float, told("Time between two of them, s; 300 where left out.", 300.0)]]
    at_most_s: NotRequired[
        Annotated[float, told("After this a person decides, s; 7200 where left out.", 7200.0)]
    ]


class NestCheckTable(TypedDict):
    """The nests are measured again while the campaign runs."""

    every: Annotated[int, told("Number of readings between two checks.", 100)]
    limit_mm: Annotated[float, told("A nest that moved by more stops for a person, mm.", 0.05)]


Approach = Annotated[
    ApproachTable, told("How the last move to a pose begins.", {"offset_deg": -5.0, "sides": "both"})
]
SettleS = Annotated[float, told("Pause before a reading, s; 4 where left out, 2 on a sphere.", 4.0)]
SettleCheck = Annotated[
    bool, told("Then also wait until two read-backs half a second apart agree; false where left out.", True)
]


class _Block(TypedDict):
    targets: NotRequired[
        Annotated[list[str], told("Names of targets of the cell; left out: all.", ["T1", "T3"])]
    ]
    approach: NotRequired[Approach]
    settle_s: NotRequired[SettleS]
    settle_check: NotRequired[SettleCheck]
    new_station: NotRequired[
        Annotated[
            bool, told("A person sets the instrument up anew before this block; false where left out.", False)
        ]
    ]


class _Chosen(_Block):
    select: NotRequired[
        Annotated[
            Literal["random", "observability", "list"],
            told(
                "How poses are chosen; `random` where left out. `file` would be one of the server and is refused.",
                "list",
            ),
        ]
    ]
    count: NotRequired[Count]
    joints_deg: NotRequired[
        Annotated[
            list[Joints],
            told(
                "The poses of `select = list`, deg, one row a pose.", [[12.0, 45.0, -10.0, 80.0, -35.0, 10.0]]
            ),
        ]
    ]


class PosesBlock(_Chosen):
    """Each pose once."""

    kind: NotRequired[Annotated[Literal["poses"], told("Left out: this kind.", "poses")]]
    set: NotRequired[Set]
    approach_sides: NotRequired[
        Annotated[
            list[list[Literal[-1, 1]]],
            told(
                "Beside `joints_deg`: from where each joint comes, 1 from below, -1 from above, one row a pose.",
                [[1, -1, 1, 1, -1, 1]],
            ),
        ]
    ]
    readings: NotRequired[
        Annotated[int, told("Readings of every target while the arm rests there; 1 where left out.", 3)]
    ]


class RepeatBlock(_Chosen):
    """The same few poses again and again: repeatability (ISO 9283)."""

    kind: Annotated[Literal["repeat"], told("The kind of block.", "repeat")]
    set: NotRequired[Annotated[Literal["repeat", "validation"], told("`repeat` where left out.", "repeat")]]
    visits: NotRequired[Annotated[int, told("Number of visits to each pose; 30 where left out.", 30)]]
    order: NotRequired[
        Annotated[
            Literal["interleaved", "row"], told("Poses take turns, or all visits of one come first.", "row")
        ]
    ]


class SweepBlock(_Block):
    """One joint turns step by step; the others do not move."""

    kind: Annotated[Literal["sweep"], told("The kind of block.", "sweep")]
    set: NotRequired[Set]
    joint: Annotated[int, told("Number of the joint that turns, from 1.", 4)]
    range_deg: NotRequired[
        Annotated[list[float], told("From and to, deg; left out: as far as limits allow.", [-90.0, 90.0])]
    ]
    step_deg: NotRequired[Step]
    at_deg: NotRequired[Posture]
    both_ways: NotRequired[Annotated[bool, told("Also down again; true where left out.", True)]]


class CirclePointBlock(_Block):
    """Several joints turn one after the other about one posture: base and tool are found from the circles."""

    kind: Annotated[Literal["circle_point"], told("The kind of block.", "circle_point")]
    set: NotRequired[Set]
    joints: NotRequired[
        Annotated[list[int], told("Numbers of the joints, from 1; left out: 1, 2 and the last two.", [1, 2])]
    ]
    width_deg: NotRequired[
        Annotated[float, told("Width of an arc, deg, at least 30; 40 where left out.", 40.0)]
    ]
    step_deg: NotRequired[Step]
    at_deg: NotRequired[Posture]


class HexapodBlock(_Block):
    """The tool on six legs of the ballbar's length."""

    kind: Annotated[Literal["hexapod"], told("The kind of block.", "hexapod")]
    set: NotRequired[Set]
    base: NotRequired[Balls]
    count: NotRequired[Annotated[int, told("Number of stances at most; left out: all.", 48)]]
    stages: NotRequired[Stages]
    configurations: NotRequired[
        Annotated[
            Literal["one", "all", "mixed"],
            told("Stances in one, in every, or in one after the other configuration of the arm.", "one"),
        ]
    ]
    branches: NotRequired[
        Annotated[
            list[str],
            told("Branches of the arm that are used; left out: all.", ["front/up", "back/down/flip"]),
        ]
    ]


class LegsBlock(_Block):
    """Given poses at which a ballbar measures given legs: the check poses of a watch."""

    kind: Annotated[Literal["legs"], told("The kind of block.", "legs")]
    set: NotRequired[Set]
    joints_deg: Annotated[list[Joints], told("The poses, deg.", [[0.0, 20.0, 0.0, 0.0, 60.0, 0.0]])]
    legs: Annotated[
        list[list[list[str]]],
        told("Of every pose its legs: target and ball on the base.", [[["T1", "B1"], ["T2", "B1"]]]),
    ]
    approach_sides: NotRequired[
        Annotated[
            list[list[Literal[-1, 1]]],
            told("+1 (from below) or -1 for every joint of every pose.", [[1, 1, -1, 1, -1, 1]]),
        ]
    ]


class BallbarGeometryBlock(_Block):
    """The sides of the triangles of the tool targets and of the balls on the base; the robot takes no part."""

    kind: Annotated[Literal["ballbar_geometry"], told("The kind of block.", "ballbar_geometry")]
    set: NotRequired[Annotated[Literal["calibration"], told("Such distances enter the fit.", "calibration")]]
    base: NotRequired[Balls]
    touch_with: NotRequired[
        Annotated[
            str,
            told("A target that a person jogs into the cup of each ball; left out: none is touched.", "T1"),
        ]
    ]
    repeats: NotRequired[Annotated[int, told("Number of times each side is measured; 1 where left out.", 2)]]


class PathBlock(_Chosen):
    """The robot drives through waypoints while joints and points are recorded."""

    kind: Annotated[Literal["path"], told("The kind of block.", "path")]
    set: NotRequired[Set]
    rest_s: NotRequired[Annotated[float, told("Rest in each waypoint, s; 2 where left out.", 2.0)]]
    robot_hz: NotRequired[Annotated[float, told("Samples of the joints, Hz; 125 where left out.", 125.0)]]
    instrument_hz: NotRequired[
        Annotated[float, told("Points of the instrument, Hz; 10 where left out.", 10.0)]
    ]
    speed_deg_s: NotRequired[
        Annotated[float, told("Largest speed of a joint, deg/s; left out: the cell's.", 20.0)]
    ]


class SphereBlock(_Block):
    """Points on a sphere about a taught centre: the ballbar check of a calibrated robot."""

    kind: Annotated[Literal["sphere"], told("The kind of block.", "sphere")]
    set: NotRequired[
        Annotated[Literal["validation", "calibration"], told("`validation` where left out.", "validation")]
    ]
    centre_deg: Annotated[
        Joints, told("Joints at which the target is in the centre, deg.", [0.0, 20.0, 0.0, 0.0, 60.0, 0.0])
    ]
    radius_mm: NotRequired[Annotated[float, told("Radius, mm; 300 where left out.", 300.0)]]
    count: NotRequired[Annotated[int, told("Number of points; 100 where left out.", 100)]]
    above_deg: NotRequired[Annotated[float, told("Lowest elevation of a point, deg; 0 where left out.", 0.0)]]
    base: NotRequired[
        Annotated[str, told("The ball in the centre, for a ballbar as long as the radius.", "N1")]
    ]
    stages: NotRequired[Stages]


BlockTable = (
    PosesBlock
    | RepeatBlock
    | SweepBlock
    | CirclePointBlock
    | HexapodBlock
    | LegsBlock
    | BallbarGeometryBlock
    | PathBlock
    | SphereBlock
)


class CampaignTable(TypedDict):
    """A campaign: what `campaign.toml` holds, as JSON.

    Every key has a default but `format` and `block`; one that is not known is refused by name. No null: leave it out.
    """

    format: Annotated[Literal["truepose-campaign/1"], told("The format of the table.", "truepose-campaign/1")]
    name: NotRequired[Annotated[str, told("A name for people; nothing depends on it.", "night 1")]]
    seed: NotRequired[
        Annotated[int, told("Everything random is drawn from it; no unit. 1 where left out.", 7)]
    ]
    order: NotRequired[
        Annotated[
            Literal["blocks", "shuffled"],
            told("`shuffled` mixes the poses of all blocks; sweeps and repeats stay whole.", "shuffled"),
        ]
    ]
    approach: NotRequired[Approach]
    settle_s: NotRequired[SettleS]
    settle_check: NotRequired[SettleCheck]
    samples: NotRequired[Annotated[int, told("Number of samples of one reading; 100 where left out.", 100)]]
    retries: NotRequired[
        Annotated[int, told("Number of times a failed reading is repeated; 2 where left out.", 2)]
    ]
    warm_up_s: NotRequired[Annotated[float, told("Wait before the first pose, s; 0 where left out.", 600.0)]]
    warm_up: NotRequired[Annotated[WarmUpTable, told("Left out: nobody waits.", {"below_mm": 0.02})]]
    nest_check: NotRequired[
        Annotated[NestCheckTable, told("Left out: not checked.", {"every": 100, "limit_mm": 0.05})]
    ]
    reference_every: NotRequired[
        Annotated[int, told("The reference pose again after this number of readings; 0: never.", 20)]
    ]
    zero_every: NotRequired[
        Annotated[int, told("The ballbar's calibrator again after this number of distances; 0: never.", 30)]
    ]
    robot: NotRequired[
        Annotated[
            dict[Literal["maker", "model", "serial"], str],
            told("The one robot that may be measured; left out: any.", {"serial": "120-500000"}),
        ]
    ]
    block: Annotated[
        list[BlockTable],
        told(
            "What is measured, one after the other.", [{"kind": "poses", "set": "calibration", "count": 60}]
        ),
    ]


Campaign = Annotated[dict[str, Any], DescribedAs(CampaignTable)]
