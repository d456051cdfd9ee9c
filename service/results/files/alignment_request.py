"""The request for an alignment of two streams.

The service keeps and checks it, and aligns in a worker.
"""

from __future__ import annotations

from dataclasses import dataclass

HOLDOUT, SEED = 0.2, 1

FARTHEST_TOOL_MM = 1e4

SLOW_MM_S = 2.0
"""The value of `calib.motion`, of which the service imports nothing."""


@dataclass(frozen=True)
class AlignmentRequest:
    """The options of an alignment: the known properties of two streams, and of the data set.

    Attributes
    ----------
    tool : tuple of float
        Target in the flange frame, mm.
    robot_in_header : str
        Name of the robot in the data set, if it differs from `robot`.
    sigma_mm : float or None
        Standard uncertainty of one coordinate of the instrument, mm. None if the header in the same folder as its
        stream states it.
    """

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
