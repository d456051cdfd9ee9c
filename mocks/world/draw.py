"""The draws of a seed: the true robot, and the material from which an effect is drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mocks.world.gravity import moments, torques
from mocks.world.kinematics import Geometry, frames, nominal_geometry
from mocks.world.robots import Load, Robot

# Typical deviations of a new arm, of the size of those in Table 2.6 of the thesis.
ALPHA_DEG, THETA_DEG, LENGTH_MM, BETA_DEG = 0.04, 0.12, 0.25, 0.03
BASE_MM, BASE_DEG = 0.3, 0.02


def deviation(rng: np.random.Generator, size: float) -> float:
    """Draw a number of random sign with magnitude 0.6 to 1.4 times `size` (bounded on purpose)."""
    return float(rng.choice((-1.0, 1.0)) * rng.uniform(0.6, 1.4) * size)


def true_geometry(robot: Robot, rng: np.random.Generator) -> Geometry:
    """Draw the DH numbers (rad, mm) of one real arm of this type.

    Its base is near the world's origin. In modified DH, link 1 is left as it is; the base takes its errors. In
    standard DH, all links are drawn. The `twisted` links also have beta, |beta| within 0.018 and 0.042 deg.
    """
    g = nominal_geometry(robot)
    first = 1 if robot.convention == "mdh" else 0
    for i in range(first, len(robot.links)):
        g.alpha[i] += math.radians(deviation(rng, ALPHA_DEG))
        g.a[i] += deviation(rng, LENGTH_MM)
        g.theta[i] += math.radians(deviation(rng, THETA_DEG))
        g.d[i] += deviation(rng, LENGTH_MM)
    for k in robot.twisted:
        g.beta[k - 1] = math.radians(deviation(rng, BETA_DEG))
    g.base_mm = [deviation(rng, BASE_MM) for _ in range(3)]
    g.base_rad = [math.radians(deviation(rng, BASE_DEG)) for _ in range(3)]
    return g


def true_compliance(robot: Robot, rng: np.random.Generator) -> list[float]:
    """c_1..c_N in rad/(N.mm): the robot's figures times 0.7 to 1.3."""
    return [c * float(rng.uniform(0.7, 1.3)) for c in robot.compliance]


def random_joints(robot: Robot, rng: np.random.Generator) -> tuple[float, ...]:
    """Draw joints in deg or mm, uniform in the robot's sensible ranges, rounded to 0.001."""
    return tuple(round(float(rng.uniform(low, high)), 3) for low, high in robot.range_deg)


@lru_cache(maxsize=16)
def torque_range(robot: Robot, loads: tuple[Load, ...]) -> tuple[float, ...]:
    """Return the largest |torque| of gravity on every joint, N.mm.

    It is taken over 200 poses in the sensible ranges.
    """
    rng = np.random.default_rng(0)
    geometry = nominal_geometry(robot)
    largest = [0.0] * len(robot.links)
    for _ in range(200):
        chain = frames(robot.convention, geometry, robot.internal(random_joints(robot, rng)))
        tau = torques(robot.convention, chain, moments(robot.convention, chain, loads))
        largest = [max(old, abs(new)) for old, new in zip(largest, tau, strict=True)]
    return tuple(largest)


@dataclass(frozen=True)
class Session:
    """Length of a campaign: number of `readings`, and `seconds` per reading."""

    readings: int = 300
    seconds: float = 20.0

    @property
    def duration_s(self) -> float:
        """Length of the whole campaign in s."""
        return self.readings * self.seconds


@dataclass(frozen=True)
class Material:
    """The material from which an effect is drawn.

    `arguments` are the parts of the label behind its first colon.
    """

    label: str
    arguments: tuple[str, ...]
    robot: Robot
    loads: tuple[Load, ...]
    session: Session
    rng: np.random.Generator

    def sign(self) -> float:
        """Draw +1 or -1."""
        return float(self.rng.choice((-1.0, 1.0)))

    def direction(self, n: int) -> list[float]:
        """Draw a random unit vector of `n` components."""
        v = self.rng.normal(size=n)
        return (v / np.linalg.norm(v)).tolist()

    def step_reading(self) -> int:
        """Draw a reading in the middle half of the campaign.

        A step there leaves enough rows on both sides.
        """
        n = self.session.readings
        return int(self.rng.integers(n // 4, max(n // 4 + 1, (3 * n) // 4)))

    def torque_range(self, joint: int) -> float:
        """Largest |gravity torque| of `joint` in N.mm."""
        return torque_range(self.robot, self.loads)[joint - 1]
