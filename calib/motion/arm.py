"""The arm of an alignment: base, tool, geometry, and the errors of its gears.

Every term displaces a slot of the chain by its parameter times a drive of the instant:

| slot | drive | the usual size of the parameter |
|---|---|---|
| base, tool point | 1 | free; the tool 50 mm |
| alpha, beta, theta, a, d of the links | 1 | 0.2 deg, 1 deg, 1 mm |
| theta_k, k > 1 | gravity torque of the robot's own loads | 1e-6 rad/(N.mm) |
| theta_k, k > 1 | gravity torque of 1 kg on the last link: a tool that no robot file knows | 5e-7 rad/(N.mm) |
| theta_k | cosine and sine of theta_k and of 2 theta_k | 0.02 deg |
| theta_k | half the direction of the joint's last motion: play | 0.02 deg |

Without the last four an arm that bends shifts the clocks: it errs along its path, and errs alike whenever it
repeats a move. With their usual sizes as priors, what a recording does not show of them is part of the clocks'
uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.kinematics import BasePoses, Chain, Frames, nominal_values, propagate, statics
from calib.arm.robot import Robot
from calib.array import Array
from calib.units import DEG, to_internal

BASE = tuple(f"base.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))
TOOL = ("target.x", "target.y", "target.z")
_SIZE = {
    "alpha": to_internal(0.2, "deg"),
    "beta": to_internal(0.2, "deg"),
    "a": 1.0,
    "theta": to_internal(1.0, "deg"),
    "d": 1.0,
}
_TOOL_SIZE_MM = 50.0  # the tool may lie on an axis that never turned: keeps what cannot be seen where it is
_COMPLIANCE, _TOOL_BENDS = 1e-6, 5e-7  # rad/(N.mm), the second one times 1 kg
_WAVE, _PLAY = 0.02 * DEG, 0.02 * DEG
_TURNS = (1, 2)  # times a turn that a gear errs
NOISE_MM = 0.05  # of a point of the moving robot, for the weight of the priors alone


@dataclass(frozen=True)
class ArmTerm:
    """A parameter of the arm.

    `slot` is the slot that it displaces, `size` its usual size (None: free), and `drive` a column of
    `_drives`.
    """

    slot: str
    size: float | None
    drive: str = "1"


class AlignedArm:
    """The arm in its place with errors of its terms, for joints that are given with their rates."""

    def __init__(self, robot: Robot, placement: Array, tool: Array, *, tool_known: bool) -> None:
        self.terms = _terms(robot, tool_known=tool_known)
        self.prior = np.array([0.0 if term.size is None else NOISE_MM / term.size for term in self.terms])
        self.placing = np.array([term.slot in (*BASE, *TOOL) for term in self.terms])
        self._robot, self._chain = robot, Chain.of(robot)
        self._placement = BasePoses(placement[:3, :3, None], placement[:3, 3, None])
        self._tool = dict(zip(TOOL, (float(x) for x in tool), strict=True))
        self._joints = [f"theta{k}" for k in range(1, robot.joints + 1)]
        self._slots = list(dict.fromkeys(term.slot for term in self.terms))

    def at(self, joints: Array, rates: Array, side: Array, estimate: Array) -> AlignedArmState:
        """Compute the arm with errors (s,) of its terms at n instants.

        `joints` (n, N) are in rad, `rates` (n, N) in rad/s; `side` (n, N) is +1 or -1 for the direction
        of the last motion.
        """
        drives = _drives(self._robot, joints, side)
        values = {**nominal_values(self._robot, joints), **self._tool}
        for term, error in zip(self.terms, estimate, strict=True):
            values[term.slot] = values.get(term.slot, 0.0) + float(error) * drives[term.drive]
        frames = propagate(self._chain, values, self._placement, None, {*self._joints, *self._slots})
        velocity = np.einsum("sxn,ns->nx", frames.velocities(self._joints), rates)
        return AlignedArmState(frames, velocity, drives)

    def columns(self, state: AlignedArmState) -> Array:
        """Differentiate the tool point by the terms, shape (n, 3, s)."""
        velocities = dict(zip(self._slots, state.frames.velocities(self._slots), strict=True))
        return np.stack([(velocities[t.slot] * state.drives[t.drive]).T for t in self.terms], axis=2)

    def without_play(self, estimate: Array) -> Array:
        """Set the errors of backlash to zero, shape (s,).

        Backlash shows in motion alone; the remaining errors depend only on the position of the arm.
        """
        return np.where([term.drive.startswith("side") for term in self.terms], 0.0, estimate)

    def tool(self, estimate: Array) -> Array:
        """Return the tool point in the flange frame, shape (3,), mm."""
        errors = {term.slot: float(error) for term, error in zip(self.terms, estimate, strict=True)}
        return np.array([self._tool[slot] + errors.get(slot, 0.0) for slot in TOOL])


@dataclass(frozen=True)
class AlignedArmState:
    """The arm at n instants.

    `frames` are its frames, `velocity` (n, 3) is that of the tool point, mm/s, and `drives` are given by
    name.
    """

    frames: Frames
    velocity: Array
    drives: dict[str, Array | float]

    @property
    def point(self) -> Array:
        """Tool point, shape (n, 3), mm."""
        return self.frames.p.T


def _terms(robot: Robot, *, tool_known: bool) -> tuple[ArmTerm, ...]:
    numbers = [f"{kind}{link}" for kind, link in robot.geometric_links]
    numbers += [f"beta{k}" for k in robot.parallel_axes]
    joints = range(1, robot.joints + 1)
    return (
        *(ArmTerm(slot, None) for slot in BASE),
        *(() if tool_known else (ArmTerm(slot, _TOOL_SIZE_MM) for slot in TOOL)),
        *(ArmTerm(slot, _SIZE[slot.rstrip("0123456789")]) for slot in numbers),
        *(ArmTerm(f"theta{k}", _COMPLIANCE, f"torque{k}") for k in joints[1:]),
        *(ArmTerm(f"theta{k}", _TOOL_BENDS, f"load{k}") for k in joints[1:]),
        *(
            ArmTerm(f"theta{k}", _WAVE, f"{wave}{turn}{k}")
            for k in joints
            for turn in _TURNS
            for wave in "cs"
        ),
        *(ArmTerm(f"theta{k}", _PLAY, f"side{k}") for k in joints),
    )


def _drives(robot: Robot, joints: Array, side: Array) -> dict[str, Array | float]:
    """Compute the drives at n instants, each (n,), by name."""
    gravity = statics(robot, joints)
    out: dict[str, Array | float] = {"1": 1.0}
    for k in range(robot.joints):
        out[f"torque{k + 1}"] = gravity.torque[:, k]
        out[f"load{k + 1}"] = gravity.unit_load[:, k, 0]
        out[f"side{k + 1}"] = 0.5 * side[:, k]
        for turn in _TURNS:
            out[f"c{turn}{k + 1}"] = np.cos(turn * joints[:, k])
            out[f"s{turn}{k + 1}"] = np.sin(turn * joints[:, k])
    return out
