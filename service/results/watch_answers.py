"""Results of watches, each described once.

They are `truepose-watch-plan/1`, `truepose-watch/1` and `truepose-upkeep/1`. The service knows them as it starts,
without what judges.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from calib.data import Dataset
from calib.text import written_by
from service import wording
from service.results.common import DeviceResponse, Joints, MeasuredPeriod
from service.results.shape import Real, ResponseBody, TableColumn, document_of, told

if TYPE_CHECKING:
    from calib.watch import WatchVerdict

_HASH = "a93c6fe109b1ae117f0e7f2bb0621db385ac9f84da4fc45fa30a1e73de499bda"


class CauseSeen(ResponseBody):
    """A cause, and from which size a plan shows it."""

    label: Annotated[str, told("The cause.", "joint_step:j4")]
    meaning: Annotated[str, told("What it means.", "Joint 4 lost its zero.")]
    seen_from: Annotated[
        Real, told("Seen in 95 of 100 watches from this size on, in `unit`.", 0.006, of="size")
    ]
    alone_from: Annotated[
        Real, told("Named alone in 80 of 100 from this size on, in `unit`.", 0.01, of="alone")
    ]
    unit: Annotated[str, told("The unit of the sizes.", "deg")]
    never_apart_from: Annotated[
        list[str], told("Causes that these readings cannot tell from it.", ["base_shift"], of="always")
    ]
    wanted: Annotated[Real, told("The size that is to be detected, in `unit`.", 0.01)]
    share_seen_at_wanted: Annotated[
        Real, told("Share of watches that see that size, no unit.", 0.97, of="share")
    ]
    lever_mm: Annotated[Real, told("How far a single target would have to be off the axis, mm.", 120.0)]


class NestsSeen(ResponseBody):
    """The nests, which are measured again half-way."""

    limit_mm: Annotated[Real, told("The limit of the check, mm.", 0.06)]
    seen_from_mm: Annotated[Real, told("A nest that moved so far is seen, mm.", 0.1, of="seen_mm")]


class WorstSeen(ResponseBody):
    """A cause and the size from which it is seen."""

    label: Annotated[str, told("The cause.", "backlash:j6")]
    seen_from: Annotated[
        Real, told("Seen from this size on, in the unit of the cause (with unit).", 0.02, of="size")
    ]


class ProposalShown(ResponseBody):
    """A choice of targets, visits and readings that detects every cause."""

    targets: Annotated[list[str], told("Names of targets.", ["T1", "T2"])]
    rounds: Annotated[int, told("Number of visits to each pose.", 4)]
    repeats: Annotated[int, told("Number of readings of a target in a visit.", 1)] = 1
    readings: Annotated[int, told("Number of readings.", 80)]
    reached: Annotated[bool, told("Whether every cause is detected at its wanted size.", True)]
    worst: Annotated[
        WorstSeen, told("The cause that is seen worst.", {"label": "backlash:j6", "seen_from": 0.02})
    ]


class WatchPlanFound(ResponseBody):
    """Check poses, and what they will show."""

    format: Annotated[Literal["truepose-watch-plan/1"], told("The format.", "truepose-watch-plan/1")]
    cell: Annotated[str, told("The cell.", "irb120-cell")]
    model: Annotated[str, told("The file of the baseline.", "model.json")]
    instrument: Annotated[str, told("The instrument.", "faro-ion")]
    targets: Annotated[list[str], told("Names of targets.", ["T1"])]
    rounds: Annotated[int, told("Number of visits to each pose.", 1)]
    repeats: Annotated[int, told("Number of readings of a target in a visit.", 1)] = 1
    readings: Annotated[int, told("Number of readings.", 10)]
    in_words: Annotated[str, told("What the poses show, in words; empty where nothing is said.", "")] = ""
    enough_poses: Annotated[int | None, told("Number of poses that would show every cause.", None)] = None
    enough_lever_mm: Annotated[
        Real,
        told("How far off the last axis a target would show what is missed of that joint, mm.", None),
    ] = None
    false_alarms: Annotated[float, told("Share of false alarms, no unit.", 0.01)]
    seen_in: Annotated[float, told("Share of watches in which `seen_from` is seen, no unit.", 0.95)]
    alone_in: Annotated[float, told("Share of watches in which `alone_from` is named alone, no unit.", 0.8)]
    poses_deg: Annotated[list[Joints], told("The poses, deg.", [[12.0, 45.0]])]
    sides: Annotated[
        list[list[int]], told("The side of approach of each joint, +1 or -1; no unit.", [[1, -1]])
    ]
    causes: Annotated[list[CauseSeen], told("What the poses will show.", [])]
    not_seen: Annotated[list[str], told("Causes that they do not show.", [])]
    nests: Annotated[NestsSeen | None, told("The nests; null where none are measured.", None)]
    proposals: Annotated[list[ProposalShown], told("What it would take to see more.", [])]


class QuestionShown(ResponseBody):
    """One test: of this watch, or of the mean over watches."""

    watches: Annotated[int, told("Number of watches that it is about.", 1)]
    values: Annotated[int, told("Number of values.", 30, of="rows")]
    t_squared: Annotated[Real, told("T-squared, no unit.", 28.1)]
    t_squared_limit: Annotated[
        Real, told("Its limit, no unit.", 61.2, of="limit"), TableColumn("limit", "{:.1f}".format)
    ]
    p_value: Annotated[
        Real,
        told("The smallest probability of a cause by chance.", 0.3),
        TableColumn("smallest p", wording.chance),
    ]
    p_limit: Annotated[Real, told("Its limit, a probability.", 0.0004), TableColumn("limit", "{:.2g}".format)]
    alarm: Annotated[
        bool,
        told("Whether it says that something has changed.", False),
        TableColumn("alarm", lambda alarm: "yes" if alarm else "no"),
    ]


class SizeShown(ResponseBody):
    """A size with its uncertainty."""

    value: Annotated[Real, told("The size, in `unit`.", 0.031)]
    u: Annotated[Real, told("U (k = 2), in `unit`.", 0.004)]
    unit: Annotated[str, told("The unit.", "deg")]

    def __str__(self) -> str:
        from calib.watch import Size

        return str(Size(**document_of(self)))


class ChangedShown(ResponseBody):
    """A parameter that has changed."""

    name: Annotated[str, told("Its name.", "zero_j4")]
    value: Annotated[Real, told("By how much, in `unit`.", 0.031)]
    u: Annotated[Real, told("U (k = 2), in `unit`.", 0.004)]
    unit: Annotated[str, told("The unit.", "deg")]


class WatchCause(ResponseBody):
    """A cause of the class that the readings leave."""

    label: Annotated[str, told("The cause.", "joint_step:j4")]
    weight: Annotated[
        Real, told("Probability among the members of the class.", 1.0), TableColumn("weight", "{:.2f}".format)
    ]
    size: Annotated[
        SizeShown, told("Its size.", {"value": 0.031, "u": 0.004, "unit": "deg"}), TableColumn("size", str)
    ]
    parameters: Annotated[list[ChangedShown], told("What has changed.", [])]
    in_words: Annotated[str, told("What has changed, a sentence.", "Joint 4 lost its zero by 0.031 deg.")]


class MissedShown(ResponseBody):
    """The error of the baseline at the check poses."""

    n: Annotated[int, told("Number of values.", 10)]
    rms: Annotated[Real, told("Root mean square, mm.", 0.081)]
    max: Annotated[Real, told("The largest, mm.", 0.15)]
    u: Annotated[Real, told("U of the RMS by instrument and frame, k = 2, mm.", 0.01)]


class _Judged(ResponseBody):
    program: Annotated[str, told("The program that judged.", "truepose 0.1.0")]
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    device: Annotated[list[DeviceResponse], told("Robot and instrument.", [])]
    measured: Annotated[MeasuredPeriod | None, told("When.", None)]
    simulated: Annotated[bool, told("Whether simulators were measured.", False)]
    exit_code: Annotated[
        int, told("The number for a PLC: 0 act on nothing, 3 changed, 6 cause unknown; no unit.", 0)
    ]
    in_words: Annotated[
        str, told("What was found, a sentence.", "Nothing has changed that these readings can see.")
    ]
    advice: Annotated[str, told("What to do, a sentence.", "Nothing.")]
    false_alarms: Annotated[float, told("Share of false alarms, no unit.", 0.01)]
    model: Annotated[str, told("The file of the baseline.", "model.json")]
    data: Annotated[str, told("The name of the table.", "data.csv")]
    data_sha256: Annotated[str, told("Hash of table and header.", _HASH)]
    updated_model: Annotated[
        str | None,
        told("There is an updated model: GET /models/ID of this job; null: none.", "model.json"),
    ]
    notes: Annotated[list[str], told("What else is to be known, in sentences.", [])]

    @classmethod
    def of(
        cls,
        dataset: Dataset,
        model: Path,
        verdict: WatchVerdict,
        updated: Path | None,
        said: Mapping[str, Any],
    ) -> Self:
        """Build the verdict on readings.

        `model` is the file of the baseline, `updated` the model that was written (None if there is none), and `said`
        holds all other members.
        """
        header = dataset.header
        return cls.model_validate(
            {
                "program": written_by(),
                "robot": header.robot.name,
                "device": [dict(each) for each in header.devices],
                "measured": header.occasion,
                "simulated": header.simulated,
                "false_alarms": verdict.rate,
                "model": model.name,
                "data": dataset.name,
                "data_sha256": dataset.sha256,
                "updated_model": None if updated is None else str(updated),
                **said,
            }
        )


class WatchResult(_Judged):
    """The verdict of a watch."""

    format: Annotated[Literal["truepose-watch/1"], told("The format.", "truepose-watch/1")]
    verdict: Annotated[
        Literal["unchanged", "changed", "ambiguous", "unexplained"], told("The verdict.", "unchanged")
    ]
    questions: Annotated[list[QuestionShown], told("Of this watch, and of the mean over watches.", [])]
    causes: Annotated[list[WatchCause], told("The members of the class, likeliest first.", [])]
    p_left: Annotated[Real, told("Probability that chance leaves as much as is left.", 0.4)]
    error_mm: Annotated[
        MissedShown, told("The error of the baseline at the check poses, mm.", {"n": 10, "rms": 0.081})
    ]


class ThermalShown(ResponseBody):
    """A thermal parameter, before and now."""

    name: Annotated[str, told("Its name.", "arm_growth")]
    before: Annotated[Real, told("Before, in `unit`.", 0.0), TableColumn("before", "{:.4g}".format)]
    value: Annotated[Real, told("Now, in `unit`.", 12.0), TableColumn("now", "{:.4g}".format)]
    u: Annotated[Real, told("U (k = 2), in `unit`.", 1.5), TableColumn("U (k = 2)", "{:.2g}".format)]
    unit: Annotated[str, told("The unit.", "ppm"), TableColumn("", str)]


class UpkeepResult(_Judged):
    """The warmth of the arm by a few readings."""

    format: Annotated[Literal["truepose-upkeep/1"], told("The format.", "truepose-upkeep/1")]
    thermal: Annotated[
        bool, told("Whether what has changed is thermal, or nothing has: then it is updated.", True)
    ]
    t_squared: Annotated[Real, told("T-squared of the rest, no unit.", 9.1)]
    t_squared_limit: Annotated[Real, told("Its limit, no unit.", 24.2)]
    values: Annotated[int, told("Number of values.", 12)]
    parameters: Annotated[list[ThermalShown], told("The thermal parameters.", [])]
    instead: Annotated[list[str], told("Causes that have changed instead.", [])]
