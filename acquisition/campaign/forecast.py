"""The duration of a campaign from its plan: moves at the cell's speeds, settling, readings, the warm-up before.

A move takes as long as its widest joint or the flange needs, plus what starting and stopping cost. What devices and
people add is not known beforehand: `seconds_left` scales the plan by how the readings so far came on. Times s of the
campaign, angles deg, lengths mm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acquisition.campaign.campaign import Campaign
from acquisition.campaign.plan import Visit
from acquisition.cell.cell import Cell
from calib.arm import forward
from calib.array import Array

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
        """The forecast of a whole plan. The robot is taken to be in its first pose already."""
        posed = [visit for visit in visits if visit.kind == "pose"]
        gate = campaign.warm_up
        before = campaign.warm_up_s + (0.0 if gate is None else (gate.over - 1) * gate.every_s)
        reading = READING_S + campaign.samples / SAMPLES_PER_S
        if not posed:
            return cls(before, np.full(sum(len(visit.targets) for visit in visits if visit.counted), reading))
        path, firsts, speeds = [posed[0].joints_deg], [], []
        for visit in posed:
            firsts.append(len(path) - 1)
            path += [visit.approach_deg, visit.joints_deg, *visit.waypoints]
            speeds += [*[cell.robot.speed_deg_s] * 2, *[_speed(cell, campaign, visit)] * len(visit.waypoints)]
        moves = np.add.reduceat(_moves_s(cell, np.array(path), np.array(speeds)), firsts)
        moves += [_rests_s(campaign, visit) for visit in posed]
        settling = [campaign.settle_of(visit.block).seconds for visit in posed]
        arriving = dict(zip((visit.number for visit in posed), moves + np.array(settling), strict=True))
        seconds: list[float] = []
        for visit in visits:
            if visit.counted:
                first = float(arriving.get(visit.number, 0.0)) + reading
                seconds += [first, *[reading] * (len(visit.targets) - 1)]
        return cls(before, np.array(seconds))

    @property
    def total_s(self) -> float:
        """Seconds from the start to the last reading."""
        return float(self._done_s[-1])

    def seconds_left(
        self, done: int, done_at_start: int = 0, elapsed_s: float = 0.0, share: float = 0.0
    ) -> float:
        """Seconds left after `done` readings, of which some were done when this execution began `elapsed_s` ago.

        share: of the reading in hand that is over, where that shows: a path says it at every waypoint, also one that is
        driven again.
        """
        last = len(self._done_s) - 1
        done, begun = min(done, last), min(done_at_start, last)
        in_hand = float(self._done_s[min(done + 1, last)] - self._done_s[done])
        left = self.total_s - float(self._done_s[done]) - share * in_hand
        if done <= begun and share > 0.0:
            return left
        if done <= begun:
            return max(0.0, left + self._before_s - elapsed_s)
        expected = self._before_s + float(self._done_s[done] - self._done_s[begun])
        return left * elapsed_s / expected if elapsed_s > 0.0 else left


def _rests_s(campaign: Campaign, visit: Visit) -> float:
    """The seconds that a path rests in its waypoints."""
    path = campaign.path_of(visit.block)
    return 0.0 if path is None or not visit.waypoints else path.rest_s * (len(visit.waypoints) + 1)


def _speed(cell: Cell, campaign: Campaign, visit: Visit) -> float:
    """The speed at which the robot drives through the waypoints of a visit, deg/s."""
    path = campaign.path_of(visit.block)
    return cell.robot.speed_deg_s if path is None or path.speed_deg_s is None else path.speed_deg_s


def _moves_s(cell: Cell, path: Array, speed_deg_s: Array) -> Array:
    """(n - 1,) s along joint angles (n, N) at the speeds (n - 1,) of the leading joint."""
    slides = np.array([kind == "slides" for kind in cell.robot.model.kinds])
    moved = np.abs(np.diff(path, axis=0))
    joints = np.where(slides, 0.0, moved).max(axis=1) / speed_deg_s
    flange = forward(cell.robot.model, cell.robot.model_angles(path))[:, :3, 3]
    straight = np.linalg.norm(np.diff(flange, axis=0), axis=1) / cell.robot.speed_mm_s
    slowest = np.maximum(joints, straight)
    return np.where(slowest > 0.0, slowest + START_AND_STOP_S, 0.0)
