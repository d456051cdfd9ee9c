"""Cups of the base taught by the robot: a person jogs a ball of the tool into each.

The joints are then read; the robot is not armed meanwhile. A touch is an arrival without a command, and a distance of
zero between the two balls. The nominal robot errs by millimetres and cups are far from each other, so its joints show
which ball sits in which cup. Angles deg, lengths mm. Source: Nubiola, thesis, section 4.2.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from acquisition.cell.cell import Cell
from acquisition.cell.picture import scene
from acquisition.cell.reach import configurations
from acquisition.cell.transit import home_of
from acquisition.cell.workspace import Array, targets_at
from acquisition.errors import TouchedElsewhere
from acquisition.record.attempts import Attempts
from acquisition.record.store import PlannedReading
from acquisition.record.touches import is_touch
from acquisition.run.prompts.picture import WORDS_ALONE, Ask, PromptPicture
from acquisition.run.rig.rig import DevicePair
from calib.errors import DataError
from drivers.errors import AcquisitionError, Refused
from drivers.interfaces import Answer, JointReading, LengthReading

WITHIN_MM = 25.0
"""Largest distance of a cup from its place in the cell file. Farther off, what was checked before is not checked."""
_TURNS = 24  # about the vertical, in which a posture over a cup is looked for


class Touches:
    """The touches of one execution.

    `ask` asks a person.
    """

    def __init__(self, cell: Cell, attempts: Attempts, rig: DevicePair, ask: Ask) -> None:
        self._cell = cell
        self._attempts = attempts
        self._rig = rig
        self._ask = ask
        self._sits: tuple[str, str] | None = None  # ball of the tool, and the cup in which it sits

    def wanted(self, planned: PlannedReading) -> bool:
        """Check whether a planned reading is a touch."""
        return is_touch(self._cell, planned)

    def take(self, planned: PlannedReading) -> Answer:
        """Have the ball placed in the cup and read the joints.

        Returns the answer of the person, CONFIRM when the touch is recorded. Errors of the robot are passed on.

        Raises
        ------
        TouchedElsewhere
            The joints show another ball or another cup.
        """
        ball, cup = planned.target, planned.base_target or ""
        near = posture_at(self._cell, ball, cup)
        self._rig.let_go()
        answer = self._ask(
            f"Jog the robot until {ball} sits in {cup}{_near(near)}, with the setting ball between them, and press "
            "confirm: its joints are read there. The robot is not armed, nothing moves by itself.",
            PromptPicture(
                drawing=scene(self._cell, None if near is None else near.tolist(), (), (ball, cup))
            ),
        )
        if answer is not Answer.CONFIRM:
            return answer
        self._sits = ball, cup
        if self._rig.hands is not None:
            self._rig.hands.touch(ball, cup, self._of_model(self._home if near is None else near))
        self._rig.meet()
        arrival = self._attempts.begin_arrival(planned.visit)
        try:
            reached = self._rig.at_rest()
        except AcquisitionError as error:
            self._attempts.failed(arrival, error)
            raise
        self._attempts.arrived(arrival, reached)
        attempt = self._attempts.begin_reading(planned, arrival)
        try:
            self._refuse_elsewhere(ball, cup, reached)
        except Refused as error:
            self._attempts.failed(attempt, error)
            raise
        touch = LengthReading(ball, cup, 0.0, 0.0, 0.0, 0.0, 1, 0.0, 0.0, raw=reached.raw)
        self._attempts.measured(attempt, planned, touch, None)
        return answer

    def leave(self) -> None:
        """Have the arm moved out of the cup before anything else.

        If this is skipped, the path from there is checked.
        """
        if self._sits is None:
            return
        ball, cup = self._sits
        answer = self._ask(
            f"Jog {ball} out of {cup} and the arm to a place high above the cups{_near(self._home)}, and press "
            "confirm.",
            WORDS_ALONE,
        )
        self._sits = None
        if answer is Answer.CONFIRM and self._rig.hands is not None:
            self._rig.hands.jog(self._of_model(self._home))

    @cached_property
    def _home(self) -> Array:
        home = home_of(self._cell)
        return np.zeros(len(self._cell.robot.limits_deg)) if home is None else np.array(home)

    def _of_model(self, joints_deg: Array) -> list[float]:
        """Convert joints to those of the model, as a simulator counts them, deg or mm."""
        robot = self._cell.robot
        return (robot.model_angles(joints_deg[None])[0] / robot.model.joint_units).tolist()

    def _refuse_elsewhere(self, ball: str, cup: str, reached: JointReading) -> None:
        """Refuse a touch that is not within `WITHIN_MM` according to the nominal robot.

        Raises
        ------
        TouchedElsewhere
            The ball is not near the cup; the message names the pair that is, if any.
        """
        cell = self._cell
        balls = targets_at(cell, np.array([reached.joints_deg]))[0]
        apart = np.linalg.norm(balls[:, None] - np.array(list(cell.nests.values())), axis=2)
        names, cups = list(cell.tool.targets), list(cell.nests)
        off = float(apart[names.index(ball), cups.index(cup)])
        if off <= WITHIN_MM:
            return
        one, other = np.unravel_index(int(np.argmin(apart)), apart.shape)
        hint = f"; it is {names[one]} in {cups[other]}" if apart[one, other] <= WITHIN_MM else ""
        raise TouchedElsewhere(
            f"by the joints of the robot {ball} is {off:.1f} mm from {cup}, and at most {WITHIN_MM:g} mm are "
            f"expected{hint}",
            device="robot",
            command=f"touch {cup}",
            raw=reached.raw,
        )


def posture_at(cell: Cell, ball: str, cup: str) -> Array | None:
    """Return a posture with a ball of the tool in a cup and the flange level above it.

    It has shape (N,), deg, and is None if the arm reaches none.
    """
    turns = np.arange(_TURNS) * 2.0 * np.pi / _TURNS
    flange = np.zeros((_TURNS, 4, 4))
    c, s = np.cos(turns), np.sin(turns)
    flange[:, 0, 0], flange[:, 0, 1], flange[:, 1, 0], flange[:, 1, 1] = c, s, s, -c
    flange[:, 2, 2], flange[:, 3, 3] = -1.0, 1.0  # looks down
    offset = flange[:, :3, :3] @ np.array(cell.tool.targets[ball])
    flange[:, :3, 3] = np.array(cell.nests[cup]) - offset
    try:
        found = configurations(cell, flange).reshape(-1, len(cell.robot.limits_deg))
    except DataError:  # no inverse kinematics in closed form
        return None
    found = found[np.all(np.isfinite(found), axis=1)]
    return found[np.argmin(np.abs(found).max(axis=1))] if len(found) else None


def _near(joints_deg: Array | None) -> str:
    if joints_deg is None:
        return ""
    return f" (for instance at {', '.join(f'{q:.0f}' for q in np.round(joints_deg) + 0.0)} deg)"
