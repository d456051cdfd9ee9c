"""The request for an alignment of two streams: the service keeps and checks it, and aligns in a worker."""

from __future__ import annotations

from dataclasses import dataclass

HOLDOUT, SEED = 0.2, 1

FARTHEST_TOOL_MM = 1e4

SLOW_MM_S = 2.0
"""The value of `calib.motion`, of which the service imports nothing."""


@dataclass(frozen=True)
class AlignmentRequest:
    """The order: what is known of two streams, and what becomes of them. tool: mm, in the flange frame;
    robot_in_header: the robot as the data set shall name it, where that is not as it is named here; sigma_mm: what one
    coordinate of the instrument is uncertain by, mm, where the header beside its stream does not say so."""

    tool: tuple[float, float, float]
    robot: str
    tool_known: bool = False
    slower_than: float = SLOW_MM_S
    coupling: str = "none"
    instrument: str = "unknown"
    robot_columns: str | None = None
    tracker_columns: str | None = None
    every_sample: bool = False
    holdout: float = HOLDOUT
    seed: int = SEED
    robot_in_header: str = ""
    sigma_mm: float | None = None
