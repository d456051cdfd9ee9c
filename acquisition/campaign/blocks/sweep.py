"""Blocks of `kind = "sweep"` and `kind = "circle_point"`: one joint turns step by step.

The other joints do not move. A sweep goes up and down again, which shows the backlash and the tangential error of its
joint (Nubiola 2.4.1). Circle points turn joints 1, 2 and the last two, one after the other, from one posture. Their
axes give starting values for base and tool (Nubiola 2.3; `calib.fit.circle_points` recognises both). Every reading has
its approach, so that an interruption changes nothing: the joint that turns arrives in the direction of the sweep, the
others from their usual side. Angles in deg.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, Strict, model_validator

from acquisition.campaign.blocks.block import (
    Block,
    BlockVisit,
    Joints,
    Posture,
    RandomStream,
    Set,
    Site,
    Step,
    rounded,
)
from acquisition.cell.cell import Cell
from acquisition.cell.transit import may_visit
from acquisition.cell.workspace import facing, is_allowed
from acquisition.file_table import Once, refused, told
from calib.array import Array
from calib.fit import FEWEST, LEAST_RANGE
from calib.units import DEG
from drivers.errors import ConfigError

_Test = Callable[[Cell, Array, Array], NDArray[np.bool_]]

_LEAST_DEG = LEAST_RANGE / DEG
_TRIES = 20_000  # postures
_BATCH = 200


class SweepBlock(Block):
    """A block in which one joint turns step by step and the others do not move."""

    kind: Annotated[Literal["sweep"], told("The kind of block.", "sweep")]
    set: Set = "calibration"
    joint: Annotated[int, told("Number of the joint that turns, from 1.", 4, ge=1, le=99)]
    range_deg: Annotated[
        Annotated[tuple[float, float], Strict(False)] | None,
        told(
            "From and to, deg; left out: as far as limits and approach allow.",
            [-90.0, 90.0],
            do="Give the lower and the upper end.",
        ),
    ] = None
    step_deg: Step = 5.0
    at_deg: Posture = None
    both_ways: Annotated[bool, told("Also down again.", True)] = True

    @model_validator(mode="after")
    def _has_two_angles(self) -> Self:
        low, high = self.range_deg or (0.0, np.inf)
        if low >= high:
            raise refused("range_deg", f"is {[low, high]!r}.", "Give the lower and the upper end.")
        if low + self.step_deg > high:
            raise refused("step_deg", f"is {self.step_deg:g}.", "A sweep needs two angles or more.")
        return self

    def visits_at(self, site: Site) -> list[BlockVisit]:
        _refuse_joint(site, self.joint)
        low, high = self.range_deg or self._widest(site)
        turn = _Turn(self.joint, _steps(low, high, self.step_deg), self.both_ways)
        sides = site.sides()
        at = self.at_deg
        posture = site.posture("at_deg", at) if at is not None else _drawn(site, [turn], sides)
        return list(turn.visits_at(site, posture, sides))

    def _widest(self, site: Site) -> tuple[float, float]:
        reach = abs(site.approach.offset_deg)
        low, high = site.cell.robot.limits_deg[self.joint - 1]
        if high - low <= 2.0 * reach:
            raise ConfigError(
                f"block {site.number + 1}: joint {self.joint} has no room for an approach of {reach:g} deg",
                what_to_do="Use a smaller offset_deg of the approach, or wider limits_deg.",
            )
        return low + reach, high - reach


class CirclePointBlock(Block):
    """A block in which several joints turn, one after the other, about one posture.

    Base and tool are found from the circles.
    """

    kind: Annotated[Literal["circle_point"], told("The kind of block.", "circle_point")]
    set: Set = "calibration"
    joints: Annotated[
        Once[Annotated[int, Field(ge=1, le=99)]] | None,
        told(
            "Numbers of the joints, from 1; left out: 1, 2 and the last two.",
            [1, 2],
            do="List numbers of joints, each once.",
        ),
    ] = None
    width_deg: Annotated[float, told("Width of an arc, deg.", 40.0, ge=_LEAST_DEG, le=360.0)] = 40.0
    step_deg: Step = 5.0
    at_deg: Posture = None

    @property
    def whole_deg(self) -> float:
        """Width of the arc in whole steps, deg.

        With whole steps the posture lies in the middle of the circle.
        """
        return float(self.step_deg * np.floor(self.width_deg / self.step_deg + 1e-9))

    @model_validator(mode="after")
    def _is_a_circle(self) -> Self:
        if self.whole_deg < max(_LEAST_DEG, (FEWEST - 1) * self.step_deg) - 1e-6:
            do = f"A circle needs {FEWEST} angles over {_LEAST_DEG:g} deg."
            raise refused("step_deg", f"is {self.step_deg:g}.", do)
        return self

    def visits_at(self, site: Site) -> list[BlockVisit]:
        count = site.cell.robot.model.joints
        joints = self.joints or (1, 2, count - 1, count)
        for joint in joints:
            _refuse_joint(site, joint)
        steps = _steps(-0.5 * self.whole_deg, 0.5 * self.whole_deg, self.step_deg)
        turns = [_Turn(joint, steps, False, about=True) for joint in joints]
        sides = site.sides()
        at = self.at_deg
        posture = site.posture("at_deg", at) if at is not None else _drawn(site, turns, sides)
        return [visit for turn in turns for visit in turn.visits_at(site, posture, sides)]


@dataclass(frozen=True)
class _Turn:
    """The angles (k,) of one joint in the order of a sweep.

    If `about` is set, they are relative to the angle of the posture.
    """

    joint: int
    angles: Array
    both_ways: bool
    about: bool = False

    def joints(self, postures: Array) -> Array:
        """Return the joints (n, k, N) of the sweep from postures (n, N)."""
        out = np.repeat(postures[:, None], len(self.angles), axis=1)
        own = postures[:, None, self.joint - 1] if self.about else 0.0
        out[:, :, self.joint - 1] = own + self.angles
        return out

    def sides(self, usual: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Return the side of approach of every joint on each pass of a sweep: up, and down again."""
        k = self.joint - 1
        return [(*usual[:k], side, *usual[k + 1 :]) for side in ((1, -1) if self.both_ways else (usual[k],))]

    def visits_at(self, site: Site, posture: Joints, usual: tuple[int, ...]) -> Iterator[BlockVisit]:
        poses = [rounded(row) for row in self.joints(np.array([posture]))[0]]
        for sides in self.sides(usual):
            side = sides[self.joint - 1]
            for pose in poses if side > 0 else reversed(poses):
                direction = "up" if side > 0 else "down"
                what = f"joint {self.joint} at {pose[self.joint - 1]:g} deg going {direction}"
                yield site.visit(what, pose, sides)


def _steps(low: float, high: float, step: float) -> Array:
    return np.array([low + step * k for k in range(int((high - low) / step + 1e-9) + 1)])


def _drawn(site: Site, turns: list[_Turn], usual: tuple[int, ...]) -> Joints:
    """Draw a posture from which all poses and approach points are clear and show the targets.

    Raises
    ------
    ConfigError
        No such posture was found.
    """
    rng = site.rng(RandomStream.POSTURE)
    low, high = np.array(site.cell.robot.limits_deg).T
    for _ in range(_TRIES // _BATCH):
        postures = np.round(rng.uniform(low, high, (_BATCH, len(low))), 1)
        # Conditions that are cheap to test and seldom true come first.
        for turn in turns:
            postures = postures[_at_all(turn.joints(postures), lambda q: facing(site.cell, q, site.targets))]
        for turn in turns:
            postures = postures[_all_good(site, turn, postures, usual, _both_allowed)]
        for posture in postures:
            if all(_all_good(site, turn, posture[None], usual, may_visit)[0] for turn in turns):
                return rounded(posture)
    raise ConfigError(
        f"block {site.number + 1}: no posture was found from which joint "
        f"{', '.join(str(turn.joint) for turn in turns)} can turn so far with "
        f"{', '.join(site.targets)} in sight",
        what_to_do="Make the range smaller, or state at_deg and targets.",
    )


def _all_good(
    site: Site, turn: _Turn, postures: Array, usual: tuple[int, ...], test: _Test
) -> NDArray[np.bool_]:
    """Check that all poses of the turns and their approach points pass the test.

    The result is a mask (n,) of the postures (n, N).
    """
    poses = turn.joints(postures)
    good = np.ones(len(poses), dtype=bool)
    for sides in turn.sides(usual):
        offset = abs(site.approach.offset_deg) * np.array(sides)
        good[good] = _at_all(poses[good], lambda q, offset=offset: test(site.cell, q, q - offset))
    return good


def _both_allowed(cell: Cell, joints_deg: Array, approach_deg: Array) -> NDArray[np.bool_]:
    return is_allowed(cell, joints_deg) & is_allowed(cell, approach_deg)


def _at_all(poses: Array, test: Callable[[Array], NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """Check for each row of the poses (n, k, N) that the test holds at all its poses."""
    n, k, joints = poses.shape
    return np.all(test(poses.reshape(-1, joints)).reshape(n, k), axis=1)


def _refuse_joint(site: Site, joint: int) -> None:
    """Refuse a joint that the robot does not have or that slides.

    Raises
    ------
    ConfigError
        The joint cannot turn.
    """
    robot = site.cell.robot.model
    if not 1 <= joint <= robot.joints:
        raise ConfigError(
            f"block {site.number + 1} turns joint {joint}, the robot has {robot.joints}",
            what_to_do="Choose another joint.",
        )
    if joint in robot.slides:
        raise ConfigError(
            f"block {site.number + 1} turns joint {joint} ({robot.axes[joint - 1]}), which slides",
            what_to_do="Choose a joint that turns.",
        )
