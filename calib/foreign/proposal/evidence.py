"""The evidence of the nominal robot: its distance from the readings under each answer to an open question.

An answer is accepted where the nominal robot in its best place, its tool unknown, then misses by less than 3 % of the
extent of the readings and every other answer misses five times as much; for conventions of orientation the same with
angles. A robot that is met to a hundredth of a millimetre was not measured: these are its controller's own numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arm.kinematics import forward
from calib.arm.robot import Robot, load_robot
from calib.arm.start import base_and_tool, tool_turn
from calib.data.hypotheses import BETTER, FEWEST, Meaning
from calib.errors import DataError
from calib.foreign.meanings.assigned import LEAVE, Question
from calib.foreign.proposal.proposed import Proposal
from calib.foreign.readings.one_file import readings_of
from calib.foreign.readings.readings import Readings
from calib.units import DEG

_BELIEVED = 0.03  # share of the extent, or rad, by which a robot may miss what it was measured at
_LEAST_DEG = 0.1  # below it two conventions are alike
_TURNED_WRONG = 5.0 * DEG  # by which no arm that reaches the points errs
_MOST = 128  # combinations of answers that are tried
ENOUGH = 300
"""Readings that tell."""
_TOO_GOOD_MM = 0.005


@dataclass(frozen=True)
class Fit:
    """The distance of readings from the nominal robot in its best place. miss: within which three quarters of them lie,
    mm; extent: of the points, or of the flange where it turns about points, mm; turn: median angle of the orientations
    from the nominal tool's, rad, NaN where none were measured.
    """

    robot: str
    miss: float
    extent: float
    turn: float
    rows: int

    @property
    def share(self) -> float:
        """The miss as a share of the extent."""
        return self.miss / max(self.extent, 1e-9)

    @property
    def sentence(self) -> str:
        """The fit in words."""
        turned = f" and {self.turn / DEG:.2f} deg" if np.isfinite(self.turn) else ""
        how = "three quarters of them, the nominal robot in its best place, tool fitted"
        return f"these fit {self.robot} to {self.miss:.3g} mm{turned} ({how})"

    @property
    def suspicious(self) -> bool:
        """Whether the nominal robot misses by more than an arm does."""
        return self.share > _BELIEVED

    @property
    def turned_wrong(self) -> bool:
        """Whether the robot reaches the points and its orientations are others."""
        return not self.suspicious and self.turn > _TURNED_WRONG

    @property
    def own_numbers(self) -> bool:
        """Whether the robot is met as only its own controller meets it."""
        return self.miss < _TOO_GOOD_MM


def fit_of(readings: Readings, robot: Robot) -> Fit | None:
    """The fit of the nominal robot to readings whose joints are in its order; None for fewer than 8 of them."""
    rows = np.flatnonzero(
        np.isfinite(readings.points).all(axis=1) & np.array([not why for why in readings.rejected])
    )
    if len(rows) < FEWEST:
        return None
    rows = rows[:: max(1, -(-len(rows) // ENOUGH))]
    few = readings.take(rows)
    names = list(dict.fromkeys(few.texts.get("target", ("",) * len(few))))
    which = np.array(
        [names.index(name) for name in few.texts.get("target", ("",) * len(few))], dtype=np.int64
    )
    tools = np.zeros((len(names), 3))
    couplings = ("none", *robot.joint_matrices)
    meanings = [Meaning(robot, coupling, few.joints, which, few.points) for coupling in couplings]
    misses = [each.miss(tools, tool_unknown=True, zero_unknown=False) for each in meanings]
    best = int(np.argmin([miss for miss, _ in misses]))
    turn = np.nan
    turned = np.isfinite(few.turns).all(axis=1)
    if turned.sum() >= FEWEST:
        flange = forward(robot, robot.model_angles(few.joints, couplings[best]))
        pose, _ = base_and_tool(flange, tools, which, few.points, tool_unknown=True)
        fixed = tool_turn(flange[turned], pose, few.turns[turned])
        there = Rotation.from_matrix(pose[:3, :3] @ flange[turned][:, :3, :3] @ fixed)
        measured = Rotation.from_quat(few.turns[turned], scalar_first=True)
        turn = float(np.median((there.inv() * measured).magnitude()))
    return Fit(robot.name, *misses[best], turn, len(few))


def decided(
    questions: Sequence[Question], proposed: Callable[[dict[str, str]], Proposal]
) -> dict[str, tuple[str, str]]:
    """Key of a question -> the answer that the robot decides, and the reason; questions it does not decide are
    absent."""
    choices = [[choice for choice in question.choices if choice != LEAVE] for question in questions]
    if any(not each for each in choices) or np.prod([len(each) for each in choices]) > _MOST:
        return {}
    tried: list[tuple[tuple[str, ...], Fit]] = []
    for combination in product(*choices):
        fit = _best(dict(zip((q.key for q in questions), combination, strict=True)), proposed)
        if fit is not None:
            tried.append((combination, fit))
    told: dict[str, tuple[str, str]] = {}
    if not tried:
        return told
    # points first: which answers let the robot reach them at all
    best = min(fit.share for _, fit in tried)
    if best > _BELIEVED:
        return told
    reach = [(combination, fit) for combination, fit in tried if fit.share < BETTER * best]
    turns = [fit.turn for _, fit in reach if np.isfinite(fit.turn)]
    near = reach
    if turns and min(turns) < _BELIEVED:
        least = max(min(turns), _LEAST_DEG * DEG)
        near = [
            (combination, fit)
            for combination, fit in reach
            if np.isfinite(fit.turn) and fit.turn < BETTER * least
        ]
    # where no orientation fits, as by a wrong answer on their convention, the points decide what is about points
    for k, question in enumerate(questions):
        left = {combination[k] for combination, _ in near}
        if len(left) == 1 and len(choices[k]) > 1:
            choice = left.pop()
            others = [fit for combination, fit in tried if combination[k] != choice]
            fit = min((fit for _, fit in near), key=lambda fit: fit.share)
            told[question.key] = (choice, _reason(question, choice, fit, others))
    return told


def _reason(question: Question, choice: str, fit: Fit, others: Sequence[Fit]) -> str:
    far = ""
    if others:
        nearest = min(others, key=lambda other: (other.share, other.turn))
        far = (
            f"; otherwise {nearest.miss:.3g} of {nearest.extent:.3g} mm"
            if nearest.share > BETTER * fit.share
            else ""
        )
        far = far or "; otherwise the orientations do not fit"
    turned = f" and {fit.turn / DEG:.2f} deg" if np.isfinite(fit.turn) else ""
    return f"{question.key} = {choice}: only so do the readings fit {fit.robot}, to {fit.miss:.3g} mm{turned}{far}"


def _best(answers: dict[str, str], proposed: Callable[[dict[str, str]], Proposal]) -> Fit | None:
    """The best fit under some answers; what these bring up in turn is tried, but orientations, which fit none."""
    try:
        proposal = proposed(answers)
    except DataError:  # answers that exclude each other
        return None
    if proposal.complete:
        return _tried(proposal)
    choices = [(LEAVE,) if LEAVE in question.choices else question.choices for question in proposal.questions]
    if proposal.missing or not all(question.evidence for question in proposal.questions):
        return None
    if np.prod([len(each) for each in choices]) > _MOST:
        return None
    keys = [question.key for question in proposal.questions]
    fits = [
        _best({**answers, **dict(zip(keys, combination, strict=True))}, proposed)
        for combination in product(*choices)
    ]
    return min((fit for fit in fits if fit is not None), key=lambda fit: fit.share, default=None)


def _tried(proposal: Proposal) -> Fit | None:
    try:
        robot = load_robot(str(proposal.made.header["robot"]), Path.cwd())
        readings, _ = readings_of(proposal.made, proposal.layouts, "the proposal")
        return fit_of(readings.of_robot(robot, "the proposal"), robot)
    except DataError:  # an answer under which the files cannot be read is not the one
        return None
