"""Calibration poses of a cell chosen by observability: the best of many random candidates.

The measurements of a cell (robot, tool, declared noise) become a set-up of `calib.selection`; `campaign.poses` decides
which poses it may take and reach. The sides of approach were drawn with the candidates, so they are as independent of
the pose as those of random poses.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acquisition.campaign.poses import Pose
from acquisition.cell.cell import Cell
from calib.data import DEFAULT_GROUPS, Noise
from calib.selection import Setup, candidates_of, choose
from calib.units import DEG

CANDIDATES = 2000
"""Candidates of a plan: 5000 raise O1 by 2 %, 1000 lower it by 1 %; the time grows with them."""

STARTS = 8


def setup_of(cell: Cell, targets: Sequence[str], groups: Sequence[str] = DEFAULT_GROUPS) -> Setup:
    """Return the measurement set-up of the cell, the same at every pose.

    Raises
    ------
    KeyError
        The cell does not have a target.
    """
    figures = cell.instrument.noise
    return Setup(
        robot=cell.robot.model,
        targets={name: cell.tool.targets[name] for name in targets},
        noise=Noise(
            "tracker",
            station_mm=cell.instrument.station_mm,
            range_mm=figures.range_mm,
            range_ppm=figures.range_ppm,
            transverse_mm=figures.transverse_mm,
            transverse_ppm=figures.transverse_ppm,
            repeatability=cell.robot.repeatability_deg * DEG,
            repeatability_mm=cell.robot.repeatability_mm,
        ),
        groups=groups,
        loads=cell.loads,
    )


def select_poses(
    cell: Cell, drawn: Sequence[Pose], count: int, rng: np.random.Generator, targets: Sequence[str]
) -> list[Pose]:
    """Choose the `count` drawn poses that determine the base model best, in random order.

    Raises
    ------
    DataError
        `count` poses cannot determine the base model.
    """
    setup = setup_of(cell, targets)
    candidates = candidates_of(setup, cell.robot.model_angles([pose.joints_deg for pose in drawn]))
    choice = choose(setup, candidates, count, starts=STARTS, seed=int(rng.integers(2**32)))
    return [drawn[i] for i in choice.selection]
