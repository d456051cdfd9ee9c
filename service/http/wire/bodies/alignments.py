"""The body of an alignment, as `--json` of the command line has it. `service.results` makes it; a test compares."""

from __future__ import annotations

from typing import Annotated, Literal

from service.http.wire.bodies.results import Warnings
from service.http.wire.bodies.told import Answered, told


class Clocks(Answered):
    """Two clocks put on one; u: one standard deviation."""

    offset_s: Annotated[float, told("The tracker's clock less the robot's, s.", 0.412)]
    u_offset_s: Annotated[float, told("Its uncertainty, s.", 0.0004)]
    rate_ppm: Annotated[float, told("How much faster the tracker's runs, ppm.", 12.1)]
    u_rate_ppm: Annotated[float, told("Its uncertainty, ppm.", 0.5)]
    at_tracker_s: Annotated[float, told("When that offset holds, s.", 300.0)]
    offset_by_speeds_s: Annotated[float, told("The offset by the speeds alone, s.", 0.41)]


class Jump(Answered):
    """A jump of a clock."""

    step_s: Annotated[float, told("Its size, s.", 0.1)]
    u_step_s: Annotated[float, told("Its uncertainty, s.", 0.001)]
    at_tracker_s: Annotated[float, told("When, s.", 212.0)]


class Gap(Answered):
    """A gap of a stream."""

    begin_s: Annotated[float, told("From, s.", 12.0)]
    end_s: Annotated[float, told("To, s.", 12.4)]
    lost: Annotated[int, told("Number of samples that are missing.", 4)]


class StreamShown(Answered):
    """A stream."""

    samples: Annotated[int, told("Number of samples.", 12500)]
    used: Annotated[int, told("Number of those that were used.", 12480)]
    period_s: Annotated[float, told("Between two of them, s.", 0.008)]
    begin_s: Annotated[float, told("The first, s.", 0.0)]
    end_s: Annotated[float, told("The last, s.", 100.0)]
    lost: Annotated[int, told("Number of samples that are missing.", 4)]
    gaps: Annotated[list[Gap], told("Where samples are missing.", [])]


class BothStreams(Answered):
    """The streams by device."""

    robot: Annotated[StreamShown, told("The robot's.", {"samples": 12500})]
    tracker: Annotated[StreamShown, told("The instrument's.", {"samples": 1000})]


class SpeedBand(Answered):
    """Errors between two speeds."""

    slowest: Annotated[float, told("From, mm/s.", 0.0)]
    fastest: Annotated[float, told("To, mm/s.", 5.0)]
    count: Annotated[int, told("Number of samples.", 400)]
    nominal_along_rms: Annotated[float, told("Of the nominal arm, along the motion, mm.", 1.1)]
    nominal_across_rms: Annotated[float, told("Of the nominal arm, across the motion, mm.", 1.0)]
    static_along_rms: Annotated[float, told("Its static part, along, mm.", 0.9)]
    static_across_rms: Annotated[float, told("Its static part, across, mm.", 0.9)]
    along_mean: Annotated[float, told("Left by the motion, along, mm; below 0: points come late.", -0.2)]
    along_rms: Annotated[float, told("Left by the motion, along, mm.", 0.3)]
    across_rms: Annotated[float, told("Left by the motion, across, mm.", 0.1)]
    across_max: Annotated[float, told("Left by the motion, across, the largest, mm.", 0.4)]
    lag_ms: Annotated[float, told("By how much points come late, ms.", 3.1)]


class AlignmentResult(Answered):
    """Two streams on one clock (`truepose-alignment/1`)."""

    format: Annotated[Literal["truepose-alignment/1"], told("The format.", "truepose-alignment/1")]
    dataset_id: Annotated[
        str, told("The id of the data set that it made.", "20261121-170459-3f9a1c07b2e")
    ] = ""
    simulated: Annotated[bool, told("Whether either stream came from a simulator.", True)] = False
    robot: Annotated[str, told("The robot file's name.", "ur5")]
    tool_mm: Annotated[list[float], told("The target on the flange as stated, mm.", [0.0, 0.0, 100.0])]
    tool_found_mm: Annotated[list[float], told("The target on the flange as found, mm.", [0.1, 0.0, 100.2])]
    clocks: Annotated[Clocks, told("The clocks.", {"offset_s": 0.412})]
    jump: Annotated[Jump | None, told("A jump of a clock, where there is one.", None)]
    streams: Annotated[BothStreams, told("What the streams hold.", {})]
    gross_errors: Annotated[int, told("Number of points that do not belong.", 0)]
    slower_than_mm_s: Annotated[float, told("Slower is a standstill, mm/s.", 1.0)]
    standstills: Annotated[int, told("Number of standstills.", 38)]
    waypoints: Annotated[int, told("Number of places where the robot stood.", 38)]
    still_samples: Annotated[int, told("Number of samples at rest.", 760)]
    rows: Annotated[int, told("Number of rows of the data set.", 38)]
    validation: Annotated[int, told("Number of those that only judge.", 8)]
    moving_error: Annotated[list[SpeedBand], told("The error by speed.", [])]
    warnings: Warnings
