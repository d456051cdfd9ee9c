"""Machine with random errors, computed by matrices that are independent of `chain.py`.

It shares no line with the chain under test. Every DH number is off, the machine stands somewhere in the tracker's
frame, its gears yield to gravity, and it has one error that no base model contains.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arm.kinematics import gravity_torques
from calib.arm.robot import Robot
from calib.array import Array
from calib.units import DEG
from tests.calib.chain import chain

TARGETS = {"T1": (60.0, 10.0, 80.0), "T2": (-50.0, 40.0, 60.0), "T3": (-10.0, -70.0, 110.0)}

Wrong = Callable[[Robot, Array, Array], dict[str, Array]]
"""What is wrong: robot, joints (n, N), sides of approach (n, N) -> slot -> (n,), rad or mm."""


@dataclass(frozen=True)
class TrueMachine:
    """Machine with its errors.

    `off` is by slot, rad or mm. `yields` is the compliance of the gears by joint, rad/(N.mm). `wrong` is the extra
    error.
    """

    robot: Robot
    off: dict[str, float]
    yields: dict[int, float]
    wrong: Wrong

    @classmethod
    def drawn(cls, robot: Robot, wrong: Wrong, rng: np.random.Generator) -> TrueMachine:
        """A machine as machines of this size are."""
        off: dict[str, float] = {}
        for k in range(1, robot.joints + 1):
            for kind, size in (("alpha", 0.05 * DEG), ("a", 0.4), ("theta", 0.1 * DEG), ("d", 0.4)):
                off[f"{kind}{k}"] = rng.normal(0.0, size)
        off |= {f"beta{k}": rng.normal(0.0, 0.05 * DEG) for k in robot.parallel_axes}
        off |= {f"base.{axis}": rng.uniform(-1000.0, 1000.0) for axis in "xyz"}
        off |= {f"base.r{axis}": rng.uniform(-0.1, 0.1) for axis in "xyz"}
        turning = [k for k in range(2, robot.joints + 1) if k not in robot.slides]
        return cls(robot, off, {k: 1e-9 * rng.uniform(0.2, 1.0) for k in turning}, wrong)

    def poses(self, joints: Array, side: Array, names: Sequence[str]) -> Array:
        """Compute the poses of tool targets in the tracker's frame, (n, 4, 4).

        The model joints (n, N) are reached from sides (n, N).
        """
        torque = gravity_torques(self.robot, joints)
        follows = self.wrong(self.robot, joints, side)
        for k, softness in self.yields.items():
            follows[f"theta{k}"] = follows.get(f"theta{k}", 0.0) + softness * torque[:, k - 1]
        constant = {slot: self.off.get(slot, 0.0) for slot in {*self.off, *follows}}
        return np.array([
            chain(
                self.robot,
                joints[i],
                constant | {slot: constant[slot] + moved[i] for slot, moved in follows.items()},
                TARGETS[name],
            ).real
            for i, name in enumerate(names)
        ])  # fmt: skip
