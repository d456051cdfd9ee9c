"""Aligned streams as tables for people on a terminal."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import RenderableType
from rich.text import Text

from service import wording
from service.printed.tables import grid, warnings
from service.results.files.alignment import StreamAlignment


def aligned(result: StreamAlignment) -> Iterable[RenderableType]:
    """Clocks, streams, standstills, the moving error by speed, and what limits them."""
    found, clocks = result.aligned, result.aligned.clocks
    shown = grid("Clocks: robot's less tracker's", "", "value", "k = 2", "unit")
    shown.columns[3].justify = "left"
    at = f"offset at {result.tracker_time(clocks.middle):.1f} s of the tracker's clock"
    shown.add_row(at, f"{result.offset:.6f}", f"{2.0 * found.u_offset:.6f}", "s")
    shown.add_row("rate", f"{1e6 * clocks.rate:+.2f}", f"{2e6 * found.u_rate:.2f}", "ppm")
    yield shown
    streams = grid("Streams", "stream", "samples", "used", "every", "gaps", "samples lost")
    for name, stream, used in (
        ("robot", result.moved, len(result.moved.time)),
        ("tracker", result.tracked, int(found.used.sum())),
    ):
        lost = sum(gap.lost for gap in stream.gaps)
        every = f"{1e3 * stream.period:.4g} ms"
        streams.add_row(name, str(len(stream.time)), str(used), every, str(len(stream.gaps)), str(lost))
    yield streams
    still, rows = result.still, len(result.table)
    held = result.table.columns.get("set", []).count("validation")
    yield Text(
        f"{wording.counted(still.count, 'standstill')} at {wording.counted(still.waypoints, 'waypoint')}: "
        f"{wording.counted(len(still.sample), 'sample')} slower than {result.order.slower_than:g} mm/s. "
        f"Data set: {wording.counted(rows, 'row')}, {held} of them held out for validation by whole waypoints."
    )
    yield _moving(result)
    yield warnings(result.warnings)


def _moving(result: StreamAlignment) -> RenderableType:
    if not result.bands:
        return Text("Too few samples in motion for an error by speed.", "yellow")
    shown = grid(
        "Error of the moving robot by speed, mm",
        "speed, mm/s",
        "n",
        "nominal along",
        "across",
        "static along",
        "across",
        "left along",
        "across",
        "across max",
        "lag, ms",
    )
    for band in result.bands:
        shown.add_row(
            f"{band.slowest:.0f} to {band.fastest:.0f}",
            str(band.count),
            *(
                wording.millimetres(x)
                for x in (
                    band.nominal_along_rms,
                    band.nominal_across_rms,
                    band.static_along_rms,
                    band.static_across_rms,
                    band.along_rms,
                    band.across_rms,
                    band.across_max,
                )
            ),
            f"{band.lag_ms:+.2f}",
        )
    shown.caption = (
        "RMS along and across the path. Nominal: the nominal arm in its best place; static: the part of it that is a "
        "matter of where the arm is, as fitted with the clocks; left: what the motion adds. A lag that is the same at "
        "all speeds is part of the clocks' offset."
    )
    shown.caption_justify = "left"
    return shown
