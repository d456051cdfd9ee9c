"""Calibration poses chosen in Python for a cell, by observability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acquisition import read_cell
from acquisition.campaign import DECIMALS, draw_poses, setup_of
from calib.array import Array
from calib.data import DEFAULT_GROUPS
from calib.prior import load_prior
from calib.selection import BesideType, Choice, Curve, beside_type, candidates_of, choose, curve_of
from truepose.frames import frame

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Selection:
    """Poses to measure. joints_deg (n, N) as the controller counts; curve: predicted U by the number of poses.

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

    def __repr__(self) -> str:
        count = len(self.joints_deg)
        return f"<{count} poses, predicted U (k = 2) {self.curve.at(count):.4f} mm>"

    @property
    def poses(self) -> pandas.DataFrame:
        """One row a pose: j1_deg and so on."""
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
    seed: int = 1,
    prior: str | Path | None = None,
) -> Selection:
    """Choose `count` poses of so many candidates that the arm of a cell file reaches. The same seed, the same poses.

    groups: what the model will free; targets: measured at every pose, default all of the cell; offset_deg: from where
    every joint arrives; prior: file of what robots of this type share, by which `of_type` says how many poses do.
    Raises DataError, ConfigError, UnsafePlan.

    >>> truepose.select("cell.toml", count=20, candidates=60)
    <20 poses, predicted U (k = 2) 0.0... mm>
    """
    the_cell = read_cell(Path(cell))
    names = list(the_cell.tool.targets) if targets is None else list(targets)
    setup = setup_of(the_cell, names, list(groups))
    rng = np.random.default_rng(seed)
    drawn = draw_poses(
        the_cell, candidates, rng, offset_deg, both=False, decimals=DECIMALS, targets=names, fewest=count
    )
    found = candidates_of(setup, the_cell.robot.model_angles([pose.joints_deg for pose in drawn]))
    choice = choose(setup, found, count, seed=seed)
    joints = np.array([drawn[i].joints_deg for i in choice.selection])
    curve = curve_of(found, choice.selection)
    if prior is None:
        return Selection(joints, choice, curve)
    of_type = load_prior(Path(prior))
    of_type.refuse_other(
        setup.robot, of_type.coupling, [e.label for e in setup.model().effects if e.owner == "robot"]
    )
    return Selection(joints, choice, curve, beside_type(found, choice.selection, curve, of_type))
