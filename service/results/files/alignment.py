"""Alignment of two streams of a moving robot on one clock, for command and service.

The subject is the calculation, its result document and its warnings.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np

from calib.arm import Robot, load_robot
from calib.convert import ConvertedTable
from calib.data import LEAST, Noise, read_noise
from calib.errors import DataError
from service.results.common import Warnings
from service.results.files.alignment_request import FARTHEST_TOOL_MM, AlignmentRequest
from service.results.shape import ResponseBody, TableColumn, told

if TYPE_CHECKING:
    from calib.motion import Aligned, JointStream, PointStream, SpeedBandErrors, Standstills

ASSUMED_MM = 0.05  # as `convert` does
_GAPS = 3  # that are named one by one
_STRETCH_S = 1.0  # of wild points: no single outliers


class ClocksResponse(ResponseBody):
    """The relation of two clocks; u is one standard deviation."""

    offset_s: Annotated[float, told("The tracker's clock less the robot's, s.", 0.412)]
    u_offset_s: Annotated[float, told("Its uncertainty, s.", 0.0004)]
    rate_ppm: Annotated[float, told("How much faster the tracker's runs, ppm.", 12.1)]
    u_rate_ppm: Annotated[float, told("Its uncertainty, ppm.", 0.5)]
    at_tracker_s: Annotated[float, told("When that offset holds, s.", 300.0)]
    offset_by_speeds_s: Annotated[float, told("The offset by the speeds alone, s.", 0.41)]


class Jump(ResponseBody):
    """A jump of a clock."""

    step_s: Annotated[float, told("Its size, s.", 0.1)]
    u_step_s: Annotated[float, told("Its uncertainty, s.", 0.001)]
    at_tracker_s: Annotated[float, told("When, s.", 212.0)]


class StreamGapResponse(ResponseBody):
    """A gap of a stream."""

    begin_s: Annotated[float, told("From, s.", 12.0)]
    end_s: Annotated[float, told("To, s.", 12.4)]
    lost: Annotated[int, told("Number of samples that are missing.", 4)]


class StreamShown(ResponseBody):
    """A stream."""

    samples: Annotated[int, told("Number of samples.", 12500)]
    used: Annotated[int, told("Number of those that were used.", 12480)]
    period_s: Annotated[float, told("Between two of them, s.", 0.008)]
    begin_s: Annotated[float, told("The first, s.", 0.0)]
    end_s: Annotated[float, told("The last, s.", 100.0)]
    lost: Annotated[int, told("Number of samples that are missing.", 4)]
    gaps: Annotated[list[StreamGapResponse], told("Where samples are missing.", [])]

    @classmethod
    def of(cls, stream: JointStream | PointStream, used: int) -> Self:
        """Describe a stream on its own clock; `used` is the number of its samples that were used."""
        return cls(
            samples=len(stream.time),
            used=used,
            period_s=stream.period,
            begin_s=stream.zero,
            end_s=stream.zero + float(stream.time[-1]),
            lost=stream.lost,
            gaps=[
                StreamGapResponse(begin_s=gap.begin + stream.zero, end_s=gap.end + stream.zero, lost=gap.lost)
                for gap in stream.gaps
            ],
        )


class BothStreams(ResponseBody):
    """The streams by device."""

    robot: Annotated[StreamShown, told("The robot's.", {"samples": 12500})]
    tracker: Annotated[StreamShown, told("The instrument's.", {"samples": 1000})]


class SpeedBand(ResponseBody):
    """Errors between two speeds."""

    slowest: Annotated[float, told("From, mm/s.", 0.0)]
    fastest: Annotated[float, told("To, mm/s.", 5.0)]
    count: Annotated[int, told("Number of samples.", 400), TableColumn("n", str)]
    nominal_along_rms: Annotated[
        float, told("Of the nominal arm, along the motion, mm.", 1.1), TableColumn("nominal along")
    ]
    nominal_across_rms: Annotated[
        float, told("Of the nominal arm, across the motion, mm.", 1.0), TableColumn("across")
    ]
    static_along_rms: Annotated[float, told("Its static part, along, mm.", 0.9), TableColumn("static along")]
    static_across_rms: Annotated[float, told("Its static part, across, mm.", 0.9), TableColumn("across")]
    along_mean: Annotated[float, told("Left by the motion, along, mm; below 0: points come late.", -0.2)]
    along_rms: Annotated[float, told("Left by the motion, along, mm.", 0.3), TableColumn("left along")]
    across_rms: Annotated[float, told("Left by the motion, across, mm.", 0.1), TableColumn("across")]
    across_max: Annotated[
        float, told("Left by the motion, across, the largest, mm.", 0.4), TableColumn("across max")
    ]
    lag_ms: Annotated[
        float, told("By how much points come late, ms.", 3.1), TableColumn("lag, ms", "{:+.2f}".format)
    ]


class AlignmentResult(ResponseBody):
    """Two streams on one clock (`truepose-alignment/1`)."""

    format: Annotated[Literal["truepose-alignment/1"], told("The format.", "truepose-alignment/1")]
    dataset_id: Annotated[
        str, told("The id of the data set that it made.", "20261121-170459-3f9a1c07b2e")
    ] = ""
    simulated: Annotated[bool, told("Whether either stream came from a simulator.", True)] = False
    robot: Annotated[str, told("The robot file's name.", "ur5")]
    tool_mm: Annotated[list[float], told("The target on the flange as stated, mm.", [0.0, 0.0, 100.0])]
    tool_found_mm: Annotated[list[float], told("The target on the flange as found, mm.", [0.1, 0.0, 100.2])]
    clocks: Annotated[ClocksResponse, told("The clocks.", {"offset_s": 0.412})]
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

    @classmethod
    def of(cls, result: StreamAlignment) -> Self:
        """Describe the alignment of two streams. Uncertainties are one standard deviation."""
        aligned, clocks = result.aligned, result.aligned.clocks
        jump = None
        if math.isfinite(clocks.step_at):
            at = result.tracker_time(clocks.step_at)
            jump = Jump(step_s=clocks.step, u_step_s=aligned.u_step, at_tracker_s=at)
        return cls(
            format="truepose-alignment/1",
            simulated=result.moved.simulated or result.tracked.simulated,
            robot=result.robot.name,
            tool_mm=list(result.order.tool),
            tool_found_mm=[float(x) for x in aligned.tool],
            clocks=ClocksResponse(
                offset_s=result.offset,
                u_offset_s=aligned.u_offset,
                rate_ppm=1e6 * clocks.rate,
                u_rate_ppm=1e6 * aligned.u_rate,
                at_tracker_s=result.tracker_time(clocks.middle),
                offset_by_speeds_s=result.offset - clocks.offset + aligned.start.offset,
            ),
            jump=jump,
            streams=BothStreams(
                robot=StreamShown.of(result.moved, len(result.moved.time)),
                tracker=StreamShown.of(result.tracked, int(aligned.used.sum())),
            ),
            gross_errors=int((aligned.weight == 0.0).sum()),
            slower_than_mm_s=result.order.slower_than,
            standstills=result.still.count,
            waypoints=result.still.waypoints,
            still_samples=len(result.still.sample),
            rows=len(result.table),
            validation=result.table.columns.get("set", []).count("validation"),
            moving_error=[SpeedBand.model_validate(band) for band in result.bands],
            warnings=result.warnings,
        )


@dataclass(frozen=True)
class StreamAlignment:
    """Alignment of two streams.

    It holds the streams, their clocks, the stationary intervals, the error of the path, and the data set of the
    stationary intervals.
    """

    order: AlignmentRequest
    robot: Robot
    moved: JointStream
    tracked: PointStream
    aligned: Aligned
    still: Standstills
    bands: list[SpeedBandErrors]
    table: ConvertedTable
    noise: Noise | None  # of the instrument; None if it is not stated

    @property
    def offset(self) -> float:
        """Offset of the robot's clock from the tracker's in the middle of the recording, s.

        It refers to the times in the files.
        """
        return self.aligned.clocks.offset + self.moved.zero - self.tracked.zero

    def tracker_time(self, time: float) -> float:
        """Convert an instant of the tracker's stream to the time in its file, s."""
        return time + self.tracked.zero

    @property
    def warnings(self) -> list[str]:
        """Reasons not to trust these figures at face value: a jump of a clock first."""
        out = [] if (jump := self._jump()) is None else [jump]
        out += self.aligned.warnings
        if self.noise is None:
            out.append(
                f"The instrument's uncertainty is not stated: no row is given less than {ASSUMED_MM:g} mm. Give "
                "--sigma, or [noise] in a .toml with the name of its stream."
            )
        for who, stream in (("tracker", self.tracked), ("robot", self.moved)):
            gaps = sorted(stream.gaps, key=lambda gap: gap.begin - gap.end)
            out += [
                f"Gap in the {who}'s stream: {gap.end - gap.begin:.2f} s from {gap.begin + stream.zero:.2f} s of its "
                f"clock on, about {gap.lost} samples lost. Nothing is interpolated there."
                for gap in gaps[:_GAPS]
            ]
            if rest := gaps[_GAPS:]:
                out.append(
                    f"{len(rest)} shorter gaps in the {who}'s stream, {sum(g.lost for g in rest)} samples lost."
                )
            if (single := stream.lost - sum(gap.lost for gap in gaps)) > 0:
                out.append(
                    f"{single} samples more are missing in the {who}'s stream, too few in one place to be a gap."
                )
            out += [f"The {who}'s stream: {remark}" for remark in stream.remarks]
        return [*out, *self._gross()]

    def _gross(self) -> list[str]:
        wild = self.aligned.weight == 0.0
        if not wild.any():
            return []
        what = f"{int(wild.sum())} points are far from the path that all others agree on; they were left out."
        edges = np.flatnonzero(np.diff(np.concatenate([[False], wild, [False]]).astype(int)))
        begins, ends = edges[::2], edges[1::2] - 1
        longest = int(np.argmax(ends - begins))
        begin, end = (float(self.tracked.time[self.aligned.used][at[longest]]) for at in (begins, ends))
        if end - begin >= _STRETCH_S:
            what += (
                f" The longest stretch of them lasts from {self.tracker_time(begin):.2f} to "
                f"{self.tracker_time(end):.2f} s of the tracker's clock, as where a target was lost."
            )
        return [what]

    def _jump(self) -> str | None:
        clocks, u_step = self.aligned.clocks, self.aligned.u_step
        if math.isinf(clocks.step_at):
            return None
        small = abs(clocks.step) < 1.0
        size = f"{1e3 * clocks.step:+.2f} ms" if small else f"{clocks.step:+.5f} s"
        return (
            f"Clock jump: from {self.tracker_time(clocks.step_at):.2f} s of the tracker's clock on, the robot's clock "
            f"is {size} (standard error {1e3 * u_step:.2f} ms) beside where it was. One of "
            "the two was set while both were running; the fit allows for it."
        )


def aligned_of(
    robot_file: Path,
    tracker_file: Path,
    order: AlignmentRequest,
    progress: Callable[[str], None] = lambda _: None,
) -> StreamAlignment:
    """Read the streams, align them and collect the stationary intervals.

    Raises
    ------
    DataError
        A file or an option is invalid; the error names file, line, column or option.
    """
    # the service describes results without them
    from calib.motion import Origin, align, by_speed, data_set, read_joints, read_points, standstills

    if not all(abs(x) <= FARTHEST_TOOL_MM for x in order.tool):
        raise DataError("is not a point on a tool.", do="Give X Y Z in mm, flange frame.", key="--tool")
    if not 0.0 < order.slower_than < math.inf:
        raise DataError(f"is {order.slower_than:g}.", do="Give mm/s, above zero.", key="--slower-than")
    if not 0.0 <= order.holdout < 1.0:
        raise DataError(f"is {order.holdout:g}.", do="Give a share from 0 to below 1.", key="--holdout")
    if not order.instrument.isprintable():
        raise DataError(
            f"is {order.instrument!r}.", do="Give a name of letters and digits.", key="--instrument"
        )
    robot = load_robot(order.robot)
    if order.coupling not in ("none", *robot.joint_matrices):
        known = ", ".join(("none", *robot.joint_matrices))
        raise DataError(f"is '{order.coupling}'.", do=f"Use {known}.", key="--coupling")
    noise = _noise(order, tracker_file.with_suffix(".toml"))
    progress(f"reading {robot_file}")
    moved = read_joints(robot_file, robot, order.coupling, order.robot_columns)
    progress(f"reading {tracker_file}")
    tracked = read_points(tracker_file, order.tracker_columns)
    aligned = align(robot, moved, tracked, order.tool, tool_known=order.tool_known, progress=progress)
    still = standstills(aligned, order.slower_than)
    origin = Origin(
        robot_name=order.robot_in_header or order.robot,
        coupling=order.coupling,
        instrument=order.instrument,
        tool=order.tool,
        tool_known=order.tool_known,
        remark=f"standstills of a moving robot, slower than {order.slower_than:g} mm/s; t_s by the robot's clock",
        simulated=moved.simulated or tracked.simulated,
    )
    table = data_set(
        robot,
        aligned,
        still,
        origin,
        noise or Noise("isotropic", ASSUMED_MM),
        every_sample=order.every_sample,
    )
    if order.holdout > 0.0:
        table = table.hold_out("random", order.holdout, order.seed)
    bands = by_speed(aligned, order.slower_than)
    return StreamAlignment(order, robot, moved, tracked, aligned, still, bands, table, noise)


def _noise(order: AlignmentRequest, header: Path) -> Noise | None:
    """Return the noise of the instrument, stated by the request or the header of its stream.

    The header is in the same folder. None if neither states it.

    Raises
    ------
    DataError
        The noise is out of range, or the header states `per-row`.
    """
    if order.sigma_mm is not None:
        if not LEAST <= order.sigma_mm <= FARTHEST_TOOL_MM:
            raise DataError(f"is {order.sigma_mm:g}.", do="Give mm, above zero.", key="--sigma")
        return Noise("isotropic", order.sigma_mm)
    if not header.is_file():
        return None
    noise = read_noise(header)
    if noise.kind == "per-row":
        raise DataError(
            "is 'per-row', and a stream has no uncertainty in its rows.",
            do="Write isotropic or tracker, or give --sigma.",
            file=header,
            key="noise.kind",
        )
    return noise
