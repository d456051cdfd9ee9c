"""The bodies of runs, loops, prompts and events."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from acquisition import State
from drivers.interfaces import Answer
from service.http.wire.bodies.fields import (
    Created,
    Id,
    Name,
    ProblemShown,
    ResponseBody,
    Simulated,
    Version,
    told,
)
from service.results.cell.accuracy import AccuracyShown, OutlookShown
from service.results.cell.loop_results import LoopResponse
from service.results.cell.proven import VerificationResult

RunState = Annotated[State, told("What it does; `state_code` is its number.", "running")]
StateCode = Annotated[
    int,
    told(
        "Number of the state: 0 draft, 1 ready, 2 running, 3 waiting_for_operator, 4 paused, 5 succeeded, 6 "
        "failed, 7 stopped.",
        2,
    ),
]
Ended = Annotated[str, told("Why it paused, failed or waits; empty while it goes on.", "")]
DryRun = Annotated[bool, told("Only checked; nothing has moved.", False)]
EventKind = Literal[
    "accept_other", "accuracy", "answer", "arrived", "attempt_died", "attempt_failed", "batch", "battery_low",
    "command", "connected", "created", "deferred", "detour", "device_needed", "device_state", "device_told", "finish",
    "finished_early", "instrument_moved",
    "link", "measure_again", "nest_doubted", "nests_checked", "nests_judged", "other_device_accepted", "planned",
    "prompt", "reading", "reconnect", "replanned", "rescued", "restation", "second_stage", "second_stage_refused",
    "skipped", "state", "taught", "warm", "warm_up", "warming_up", "waypoint", "world_frame", "zeroed",
]  # fmt: skip
"""Every kind of event that a record may hold."""


class EntryShown(ResponseBody):
    """Numbers that must be typed together with the answer confirm."""

    names: Annotated[list[str], told("What the numbers are, in their order.", ["x", "y", "z"])]
    unit: Annotated[str, told("Their unit.", "mm")]
    shown: Annotated[
        list[str], told("What the display should show; empty where nobody knows.", ["12.50", "-3.00"])
    ]
    needed: Annotated[bool, told("False: confirm alone says that the display shows just that.", True)]


class PromptShown(ResponseBody):
    """A question to a person."""

    id: Annotated[str, told("Its id, for the path of the answer.", "p7")]
    text: Annotated[str, told("The question.", "Seat the SMR in T1 and press confirm.")]
    picture: Annotated[str | None, told("The name of a picture that goes with it.", None)]
    expects: Annotated[list[Answer], told("The answers that can be given.", ["confirm", "abort"])]
    entry: Annotated[EntryShown | None, told("Numbers to be typed; null: none.", None)] = None


class LastReading(ResponseBody):
    """The last good reading: a point of a tracker, or a distance of a ballbar."""

    attempt: Annotated[int, told("Number of the attempt in the record.", 118)]
    pose: Annotated[int, told("Number of the planned reading.", 57)]
    name: Annotated[str, told("The pose by name.", "calibration 19")]
    set: Annotated[str, told("calibration, validation, repeat, reference or nest.", "calibration")]
    target: Annotated[str, told("The target that was measured.", "T1")]
    t_air_c: Annotated[float | None, told("The air, degC.", 21.9)] = None
    tracker_mm: Annotated[
        list[float] | None, told("x, y, z in the instrument's frame, mm.", [2103.4, 88.1, -310.9])
    ] = None
    world_mm: Annotated[
        list[float] | None,
        told("x, y, z in the world frame, mm; null until that is known.", [401.2, 88.1, 310.4]),
    ] = None
    as_planned_mm: Annotated[
        list[float] | None,
        told(
            "The same at the joints planned, mm: another point where a person drives the robot; null for nests.",
            [401.2, 88.1, 310.4],
        ),
    ] = None
    base_target: Annotated[str | None, told("Of a distance, the ball on the base.", "N1")] = None
    length_mm: Annotated[float | None, told("Of a distance, its length, mm.", 300.012)] = None


class DriftResponse(ResponseBody):
    """The drift of the reference pose from its first measured position."""

    readings: Annotated[int, told("Number of readings of the reference pose.", 6)]
    now_mm: Annotated[list[float], told("x, y, z of the last against the first, mm.", [0.004, -0.011, 0.002])]
    off_mm: Annotated[float, told("Length of that, mm.", 0.012)]
    most_mm: Annotated[float, told("The most it has ever been, mm.", 0.015)]
    t_s: Annotated[float, told("When that was, s since the start of the campaign.", 5400.0)]


class StreamCounts(ResponseBody):
    """Counts of the two streams of a path."""

    robot: Annotated[int, told("Number of the robot's.", 12500)] = 0
    instrument: Annotated[int, told("Number of the instrument's.", 1000)] = 0


class PathShown(ResponseBody):
    """The progress of a path that is recorded in motion."""

    attempt: Annotated[int, told("Number of the attempt in the record.", 3)]
    waypoint: Annotated[int, told("Number of the last waypoint that was reached.", 17)]
    of: Annotated[int, told("Number of waypoints.", 38)]
    samples: Annotated[StreamCounts, told("Samples so far.", {"robot": 12500, "instrument": 1000})]
    lost: Annotated[StreamCounts, told("Samples that are missing.", {"robot": 0, "instrument": 0})]


class DeviceError(ResponseBody):
    """A failure of a device, or of the record."""

    code: Annotated[int, told("Number of the kind of error; no unit.", 2001)]
    name: Annotated[str, told("The kind of error.", "TargetNotSeen")]
    device: Annotated[str, told("robot, instrument, or empty.", "instrument")]
    command: Annotated[str, told("What was under way.", "measure")]
    message: Annotated[str, told("What happened.", "the beam is broken")]
    raw: Annotated[str, told("The device's own reply.", "")]
    what_to_do: Annotated[str, told("One sentence for the person at the cell.", "Clear the line of sight.")]


class EarlyEnd(ResponseBody):
    """The end of a run that a person ended early."""

    by: Annotated[str, told("Who ended it.", "anna")]
    reason: Annotated[str, told("Why; empty if nobody said.", "")]
    utc: Annotated[str, told("When that was ordered, RFC 3339 UTC.", "2026-11-21T17:04:59.120Z")]
    measured: Annotated[int, told("Number of readings that were measured.", 118)]
    total: Annotated[int, told("Number of readings that were planned.", 300)]


class RunResponse(ResponseBody):
    """A run. `version` grows with everything that happens to it."""

    id: Id
    name: Name
    state: RunState
    state_code: StateCode
    reason: Ended
    version: Version
    done: Annotated[int, told("Number of readings that are done; skipped ones count.", 118)]
    total: Annotated[int, told("Number of readings that are planned.", 300)]
    skipped: Annotated[int, told("Number of readings that were given up.", 1)]
    prompt: Annotated[PromptShown | None, told("The question that waits for its answer.", None)]
    last_reading: Annotated[LastReading | None, told("The last good reading.", None)]
    seconds_left: Annotated[float | None, told("Until the end, s; null where it is not known.", 840.0)]
    drift: Annotated[
        DriftResponse | None, told("Of the reference pose; null before its second reading.", None)
    ] = None
    path: Annotated[PathShown | None, told("How far a path has come.", None)] = None
    accuracy: Annotated[
        AccuracyShown | None, told("What an adaptive campaign has reached; null before its first look.", None)
    ] = None
    finished_early: Annotated[
        EarlyEnd | None, told("Who ended it early, as succeeded; null where nobody did.", None)
    ] = None
    unprotected: Annotated[
        int, told("Number of readings without a checksum; always 0: every one has it.", 0)
    ] = 0
    simulated: Simulated
    dry_run: DryRun
    damaged: Annotated[bool, told("Its record cannot be used; a rescue may save readings.", False)] = False
    error: Annotated[DeviceError | None, told("Why it paused or failed, where a device is to blame.", None)]
    problems: Annotated[
        list[DeviceError], told("In the answer to a stop: what could not be stopped.", [])
    ] = Field(default_factory=list)


class LoopKept(ResponseBody):
    """The members that the file of each closed loop must have."""

    id: Id
    name: Name
    state: RunState
    version: Version
    runs: Annotated[list[str], told("Ids of its runs, oldest first.", [])]
    run_id: Annotated[str | None, told("The run in hand.", None)]
    dry_run: DryRun


class WorkAsked(ResponseBody):
    """The member common to the files with the arguments of a loop or verification."""

    cell: str


class LoopAsked(WorkAsked):
    """The members of the file with the arguments of a closed loop."""

    campaign: str
    poses: int


class WorkShown(LoopKept):
    """The members that a closed loop and a verification have in common."""

    created_utc: Created
    state_code: StateCode
    reason: Ended
    step: Annotated[str, told("What it does now.", "diagnosis")]
    steps: Annotated[list[str], told("What it has done, the last in hand.", ["campaign", "diagnosis"])]
    run: Annotated[RunResponse | None, told("The run in hand.", None)]
    simulated: Simulated
    problem: Annotated[ProblemShown | None, told("What it failed or rests for.", None)]
    problems: Annotated[
        list[DeviceError], told("In the answer to a stop: what could not be stopped.", [])
    ] = Field(default_factory=list)


class LoopShown(WorkShown):
    """A closed loop: `step` is its current step, `run` the current one of `runs`.

    `result` is present once the loop has finished.
    """

    dataset_id: Annotated[str | None, told("The id of its readings, once it is through.", None)]
    outlook: Annotated[
        OutlookShown | None, told("What it is expected to need, where an accuracy was asked for.", None)
    ] = None
    result: Annotated[LoopResponse | None, told("The diagnosis and its verification.", None)]
    report: Annotated[
        str | None, told("The path of its report.", "/api/v1/reports/20261121-170459-3f9a1c07b2e")
    ]


class VerificationOrder(ResponseBody):
    """The arguments of a verification."""

    model_id: Annotated[str, told("The id of the model; empty: it was sent.", "20261121-170459-3f9a1c07b2e")]
    poses: Annotated[int, told("Number of new poses.", 10)]
    seed: Annotated[int, told("Number from which the poses are drawn; no unit.", 1)]


class VerificationAsked(WorkAsked, VerificationOrder):
    """The members of the file with the arguments of a verification."""


class VerificationShown(WorkShown, VerificationOrder):
    """The proof of a model on the robot.

    `step` is its current step, `run` the current one of `runs`.
    `result` is present once it has finished.
    """

    result: Annotated[VerificationResult | None, told("What it has shown.", None)]


class EventShown(ResponseBody):
    """One event of a run: a line of `events.jsonl`, or the `data` of one server-sent event.

    In the stream `id` is also the field `id` and `kind` the field `event`.
    """

    id: Annotated[
        int, told("Grows without end; the version of the run is that of its last event. No unit.", 412)
    ]
    utc: Annotated[str, told("When, RFC 3339 UTC.", "2026-11-21T17:04:59.120Z")]
    t_s: Annotated[float | None, told("When, s since the start of the campaign.", 812.4)]
    kind: Annotated[EventKind, told("What has happened.", "reading")]
    data: Annotated[
        dict[str, Any],
        told("The rest, by kind: see `streamEvents`. Lengths mm, angles deg.", {"target": "T1"}),
    ]


class Runs(ResponseBody):
    """Every run."""

    runs: Annotated[list[RunResponse], told("Newest first.", [])]


class LoopList(ResponseBody):
    """Every loop."""

    loops: Annotated[list[LoopShown], told("Newest first.", [])]


class VerificationList(ResponseBody):
    """Every verification."""

    verifications: Annotated[list[VerificationShown], told("Newest first.", [])]


class Prompts(ResponseBody):
    """The prompts of a run."""

    prompts: Annotated[list[PromptShown], told("The one that is open, or none.", [])]
