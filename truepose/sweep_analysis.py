"""Joints that were turned alone, analysed in Python."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calib.fit import silent
from service.results.models.swept import SweepsResult
from truepose.arguments import refuse_other_level
from truepose.data import Data, data_of
from truepose.frames import frame_of_rows

if TYPE_CHECKING:
    import pandas

_OF_READINGS = ("angle_deg", "tangential_deg", "radial_mm", "axial_mm", "upwards")
_OF_JOINTS = (
    "series", "target", "readings", "from_deg", "to_deg", "radius_mm", "error_range_deg", "reversal_deg",
    "u_reversal_deg", "radial_rms_mm", "radial_largest_mm", "axial_rms_mm", "axial_largest_mm",
)  # fmt: skip


@dataclass(frozen=True)
class Sweeps:
    """The sweeps of single joints in a data set.

    Attributes
    ----------
    result :
        Everything that is reported, as `truepose sweeps --json` writes it.

    >>> found = truepose.sweeps("sweeps.csv")
    >>> found.joints[["reversal_deg", "radial_rms_mm", "axial_rms_mm"]].round(2).loc[5].to_list()
    [-0.03, 0.01, 0.01]
    """

    result: SweepsResult

    def __repr__(self) -> str:
        return f"<sweeps of joints {', '.join(str(each.joint) for each in self.result.sweeps)}>"

    @property
    def joints(self) -> pandas.DataFrame:
        """Table of the sweeps, one row each: error range and reversal, deg, deviations from the circle, mm."""
        rows = [each.model_dump(include={"joint", *_OF_JOINTS}) for each in self.result.sweeps]
        return frame_of_rows(rows, _OF_JOINTS, "joint")

    @property
    def readings(self) -> pandas.DataFrame:
        """Table of the readings: angle and tangential error, deg, radial and axial deviation, mm, direction."""
        rows = [
            {"joint": each.joint, "series": each.series, "target": each.target}
            | dict(zip(_OF_READINGS, values, strict=True))
            for each in self.result.sweeps
            for values in zip(*(getattr(each, name) for name in _OF_READINGS), strict=True)
        ]
        return frame_of_rows(rows, ("series", "target", *_OF_READINGS), "joint")


def sweeps(
    data: Data | str | Path, *, level: int | None = None, progress: Callable[[str], None] | None = None
) -> Sweeps:
    """Analyse joints that were turned alone: tangential error, reversal, axis, and deviation from the circle.

    Parameters
    ----------
    level :
        1 joints, 2 geometry, 3 and gravity: what the identification frees with whose axes those of the sweeps are
        compared. Default: what the header frees.
    progress :
        Called with the text of each step.

    Raises
    ------
    DataError
        The data or an argument cannot be used, or there is no sweep.

    >>> truepose.sweeps("sweeps.csv")
    <sweeps of joints 1, 2, 5>
    """
    refuse_other_level(level)
    return Sweeps(SweepsResult.of(data_of(data).dataset, level, progress or silent))
