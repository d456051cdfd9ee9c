"""Aligned streams as tables for people on a terminal."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import RenderableType
from rich.text import Text

from service import wording
from service.printed.tables import grid, table_of, warnings
from service.results.files.alignment import AlignmentResult, SpeedBand


def aligned(result: AlignmentResult) -> Iterable[RenderableType]:
    """Show clocks, streams, stationary intervals, the error in motion by speed, and warnings."""
    clocks = result.clocks
    shown = grid("Clocks: robot's less tracker's", "", "value", "k = 2", "unit")
    shown.columns[3].justify = "left"
    at = f"offset at {clocks.at_tracker_s:.1f} s of the tracker's clock"
    shown.add_row(at, f"{clocks.offset_s:.6f}", f"{2.0 * clocks.u_offset_s:.6f}", "s")
    shown.add_row("rate", f"{clocks.rate_ppm:+.2f}", f"{2.0 * clocks.u_rate_ppm:.2f}", "ppm")
    yield shown
    streams = grid("Streams", "stream", "samples", "used", "every", "gaps", "samples lost")
    for name, stream in (("robot", result.streams.robot), ("tracker", result.streams.tracker)):
        counts = (len(stream.gaps), sum(gap.lost for gap in stream.gaps))
        every = f"{1e3 * stream.period_s:.4g} ms"
        streams.add_row(name, str(stream.samples), str(stream.used), every, *map(str, counts))
    yield streams
    yield Text(
        f"{wording.counted(result.standstills, 'standstill')} at {wording.counted(result.waypoints, 'waypoint')}: "
        f"{wording.counted(result.still_samples, 'sample')} slower than {result.slower_than_mm_s:g} mm/s. "
        f"Data set: {wording.counted(result.rows, 'row')}, {result.validation} of them held out for validation by "
        "whole waypoints."
    )
    yield _moving(result.moving_error)
    yield warnings(result.warnings)


def _moving(bands: list[SpeedBand]) -> RenderableType:
    if not bands:
        return Text("Too few samples in motion for an error by speed.", "yellow")
    rows = ((f"{band.slowest:.0f} to {band.fastest:.0f}", band) for band in bands)
    shown = table_of(SpeedBand, "Error of the moving robot by speed, mm", ("speed, mm/s",), rows)
    shown.caption = (
        "RMS along and across the path. Nominal: the nominal arm in its best place; static: the part of it that is a "
        "matter of where the arm is, as fitted with the clocks; left: what the motion adds. A lag that is the same at "
        "all speeds is part of the clocks' offset."
    )
    shown.caption_justify = "left"
    return shown
