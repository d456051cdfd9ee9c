"""How long a campaign takes, from its plan: moves at the cell's speeds, settling, readings, the warm-up before.

A move takes as long as its widest joint or the flange needs, plus what starting and stopping cost. What devices and
people add is not known beforehand: `seconds_left` scales the plan by how the readings so far came on. Times s of the
campaign, angles deg, lengths mm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acquisition.campaign import Campaign
from acquisition.cell import Cell
from acquisition.plan import Visit
from calib.kinematics import Array, forward

START_AND_STOP_S = 0.3  # of a move
READING_S = 1.0  # beam and reply, beside the samples
SAMPLES_PER_S = 1000.0


class Forecast:
    """Expected time until each reading of a pose is done, in the order of the plan."""

    def __init__(self, before_s: float, readings_s: Array) -> None:
        self._done_s = before_s + np.concatenate([[0.0], np.cumsum(readings_s)])
        self._before_s = before_s

    @classmethod
    def of(cls, cell: Cell, campaign: Campaign, visits: Sequence[Visit]) -> Forecast:
        """Of a whole plan. The robot is taken to stand in its first pose."""
        standing = [visit for visit in visits if visit.kind == "pose"]
        gate = campaign.warm_up
        before = campaign.warm_up_s + (0.0 if gate is None else (gate.over - 1) * gate.every_s)
        if not standing:
            return cls(before, np.zeros(0))
        path = [standing[0].joints_deg]
        for visit in standing:
            path += [visit.approach_deg, visit.joints_deg]
        moves = _moves_s(cell, np.array(path)).reshape(-1, 2).sum(axis=1)
        settling = [campaign.settle_of(visit.block).seconds for visit in standing]
        reading = READING_S + campaign.samples / SAMPLES_PER_S
        seconds: list[float] = []
        for visit, arriving in zip(standing, moves + np.array(settling), strict=True):
            seconds += [float(arriving) + reading, *[reading] * (len(visit.targets) - 1)]
        return cls(before, np.array(seconds))

    @property
    def total_s(self) -> float:
        """From the start to the last reading."""
        return float(self._done_s[-1])

    def seconds_left(self, done: int, done_at_start: int = 0, elapsed_s: float = 0.0) -> float:
        """After `done` readings, of which some were done when this execution began `elapsed_s` ago."""
        last = len(self._done_s) - 1
        done, begun = min(done, last), min(done_at_start, last)
        left = self.total_s - float(self._done_s[done])
        if done <= begun:
            return max(0.0, left + self._before_s - elapsed_s)
        expected = self._before_s + float(self._done_s[done] - self._done_s[begun])
        return left * elapsed_s / expected if elapsed_s > 0.0 else left


def _moves_s(cell: Cell, path: Array) -> Array:
    """(n - 1,) s along joint angles (n, N)."""
    joints = np.abs(np.diff(path, axis=0)).max(axis=1) / cell.robot.speed_deg_s
    flange = forward(cell.robot.model, cell.robot.model_angles(path))[:, :3, 3]
    straight = np.linalg.norm(np.diff(flange, axis=0), axis=1) / cell.robot.speed_mm_s
    slowest = np.maximum(joints, straight)
    return np.where(slowest > 0.0, slowest + START_AND_STOP_S, 0.0)
