"""Independently written effects, planted at the size that a report promised to detect.

The report promises detection in 95 of 100 sets.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.diagnose import diagnose
from tests.benchmarks.strangers.arms import arms
from tests.benchmarks.strangers.scene import Act, Moved, Scene
from tests.benchmarks.strangers.sets import SMALL_MM, SMALL_RAD, Plan, made

READINGS, VALIDATION = 200, 12
DEG = math.radians(1.0) / SMALL_RAD  # of what an act moves
MOST = {
    "backlash": 1.0,
    "encoder_scale": 1500.0,
    "coupling": 2e4,
    "thermal_joint": 0.5,
    "tracker_scale": 500.0,
}
"""Sizes beyond which none is believed, in the units of the report: a promise above them cannot be tried."""


@dataclass(frozen=True)
class Planted:
    """Planted effect, with its place, its size and the report on it."""

    label: str
    arm: str
    seed: int
    size: float
    told: tuple[str, ...]
    seen: bool

    @property
    def kind(self) -> str:
        """Kind of the effect, without the joint."""
        return self.label.partition(":")[0]

    def __str__(self) -> str:
        return f"{self.label} {self.size:.3g} on {self.arm}, seed {self.seed}: {' + '.join(self.told) or 'nothing'}"


def backlash(joint: int, deg: float) -> Act:
    """Play: half of it on either side."""
    return lambda s: Moved({joint: 0.5 * deg * DEG * s.side[:, joint - 1]})


def encoder_scale(joint: int, ppm: float) -> Act:
    """A share of the angle."""
    return lambda s: Moved({joint: 1e-6 * ppm * s.joints[:, joint - 1] / SMALL_RAD})


def coupling(joint: int, ppm: float) -> Act:
    """The joint after it turns by a share of its angle."""
    return lambda s: Moved({joint + 1: 1e-6 * ppm * s.joints[:, joint - 1] / SMALL_RAD})


def thermal_joint(joint: int, deg: float) -> Act:
    """A zero that follows the air, deg/K."""
    return lambda s: Moved({joint: deg * DEG * (s.air - s.air.mean())})


def tracker_scale(_: int, ppm: float) -> Act:
    """The beam is a share longer."""

    def act(s: Scene) -> Moved:
        along, distance = s.beam
        return Moved(point=1e-6 * ppm * distance[:, None] * along / SMALL_MM)

    return act


KINDS: tuple[tuple[Callable[[int, float], Act], str], ...] = (
    (backlash, "backlash:j{0}"),
    (encoder_scale, "encoder_scale:j{0}"),
    (coupling, "coupling:j{0}-j{1}"),
    (thermal_joint, "thermal_joint:j{0}"),
    (tracker_scale, "tracker_scale"),
)
"""Effects of one size, not scanned: of others the promise is that of their least visible direction, or a median."""


def planted(asked: tuple[int, int]) -> list[Planted]:
    """Plant one effect of every kind, one after the other, in an otherwise complete campaign.

    Each acts at a random joint. The list is empty if that campaign already raises an alarm without them.
    """
    number, seed = asked
    arm = arms()[number]
    rng = np.random.default_rng([seed, number, 5])
    plan = Plan(READINGS, VALIDATION)
    nothing = diagnose(made(arm, None, None, plan, seed).data)
    if nothing.verdict != "complete":
        return []
    promised = {each.label: each.size for each in nothing.power}
    found = []
    for act, template in KINDS:
        joint = int(rng.integers(1, arm.joints))
        label = template.format(joint, joint + 1)
        size = promised.get(label)
        if size is None or size > MOST[act.__name__]:
            continue
        result = diagnose(made(arm, act(joint, size), None, plan, seed).data)
        told = tuple(" | ".join(f.evidence.candidates) for f in result.effects)
        seen = any(label in f.evidence.candidates for f in result.effects)
        found.append(Planted(label, arm.name, seed, size, told, seen))
    return found
