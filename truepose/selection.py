"""Calibration poses chosen in Python for a cell, by observability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acquisition import read_cell
from calib.array import Array
from calib.data import DEFAULT_GROUPS
from calib.prior import load_prior
from calib.selection import SHARE, BesideType, Choice, Curve
from service.results.cell.selected import Selected, SelectionRequest
from truepose.frames import frame

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Selection:
    """Poses to measure.

    Attributes
    ----------
    joints_deg :
        The poses, (n, N), as the controller counts.
    curve :
        Predicted U by the number of poses.
    reached_with :
        Number of poses that reach the required U; None if they do not, or none is required.

    >>> chosen = truepose.select("cell.toml", count=20, candidates=60)
    >>> chosen.poses.shape  # deg
    (20, 6)
    >>> bool(chosen.u_by_count["largest_mm"].is_monotonic_decreasing)
    True
    """

    joints_deg: Array
    choice: Choice
    curve: Curve
    of_type: BesideType | None = None
    reached_with: int | None = None

    def __repr__(self) -> str:
        count = len(self.joints_deg)
        return f"<{count} poses, predicted U (k = 2) {self.curve.at(count):.4f} mm>"

    @property
    def poses(self) -> pandas.DataFrame:
        """Table of the poses, one row each: j1_deg and so on."""
        return frame({f"j{k + 1}_deg": self.joints_deg[:, k] for k in range(self.joints_deg.shape[1])})

    @property
    def u_by_count(self) -> pandas.DataFrame:
        """Predicted U (k = 2), mm, largest and mean over the workspace, by the number of poses."""
        columns = {"largest_mm": self.curve.largest, "mean_mm": self.curve.mean}
        return frame(columns, self.curve.counts.tolist(), "poses")


def select(
    cell: str | Path,
    *,
    count: int = 50,
    candidates: int = 5000,
    groups: Sequence[str] = DEFAULT_GROUPS,
    targets: Sequence[str] | None = None,
    offset_deg: float = -5.0,
    share: float = SHARE,
    wanted_u: float | None = None,
    seed: int = 1,
    prior: str | Path | None = None,
) -> Selection:
    """Choose calibration poses of an arm by observability. The same seed gives the same poses.

    Parameters
    ----------
    cell :
        The cell file; candidates are drawn at random from the poses that its arm reaches.
    count, candidates :
        Number of poses to choose, and of candidates.
    groups :
        Groups of parameters that the model will free.
    targets :
        Targets measured at every pose. Default: all of the cell.
    offset_deg :
        How far before its pose every joint begins the last move, deg.
    share :
        Share of the poses that may fill the ranges of the joints.
    wanted_u :
        Predicted U (k = 2) that is required, mm: `reached_with` states the number of poses for it.
    prior :
        File of the statistics of this robot type: `of_type` states how many poses are enough with it.

    Raises
    ------
    DataError, ConfigError, UnsafePlan
        The cell, a target or the prior cannot be used, or too few poses are reached.

    >>> truepose.select("cell.toml", count=20, candidates=60)
    <20 poses, predicted U (k = 2) 0.0... mm>
    """
    found = Selected.of(
        read_cell(Path(cell)),
        SelectionRequest(
            count=count,
            candidates=candidates,
            groups=tuple(groups),
            targets=None if targets is None else tuple(targets),
            offset_deg=offset_deg,
            share=share,
            wanted_u=wanted_u,
            seed=seed,
            prior=None if prior is None else load_prior(Path(prior)),
        ),
    )
    joints = np.array([pose.joints_deg for pose in found.poses])
    reached = None if wanted_u is None else found.curve.reaches(wanted_u)
    return Selection(joints, found.choice, found.curve, found.of_type, reached)
