"""Laws of instruments, floors, warmth and air."""

from __future__ import annotations

import numpy as np

from tests.benchmarks.strangers.arms import Array
from tests.benchmarks.strangers.laws_of_arms import JOINTS
from tests.benchmarks.strangers.scene import Moved, Scene, law

TIME = ("time", "temperature")
SIGHT = ("direction of view", "distance from the instrument", "region", "overturning", *JOINTS)


def relaxed(cause: Array, time: Array, constant: float) -> Array:
    """A first order lag of a cause (n,) with a time constant, s."""
    out, state = np.empty(len(cause)), cause[0]
    steps = np.diff(time, prepend=time[0])
    for i, (now, step) in enumerate(zip(cause, steps, strict=True)):
        state += (now - state) * (1.0 - np.exp(-step / constant))
        out[i] = state
    return out


def red_noise(s: Scene, keep: float) -> Array:
    """Draw noise (n,) that keeps a share of the reading before."""
    out = s.rng.normal(size=s.count)
    for i in range(1, s.count):
        out[i] = keep * out[i - 1] + np.sqrt(1.0 - keep**2) * out[i]
    return out


@law("region", "direction of view", "distance from the instrument", *JOINTS)
def smooth_in_the_room(s: Scene) -> Moved:
    """A field over the workspace, as wide as a third of the reach."""
    return Moved(point=s.field(s.place, s.arm.reach / 3.0, 3))


@law(*SIGHT)
def bent_beam(s: Scene) -> Moved:
    """Bend the beam by warm air above a cold floor.

    The point rises with the square of the distance, more near the floor.
    """
    _, distance = s.beam
    height = (s.place[:, 2] + s.station[2]) / (2.0 * s.arm.reach)
    bend = (distance / np.mean(distance)) ** 2 * np.exp(-2.0 * height)
    return Moved(point=np.column_stack([np.zeros((s.count, 2)), 3.0 * bend]))


@law(*SIGHT)
def cyclic_range(s: Scene) -> Moved:
    """Add the modulation error of the distance meter: a wave over the range.

    The wave is as long as half the reach.
    """
    along, distance = s.beam
    return Moved(point=along * np.sin(4.0 * np.pi * distance / s.arm.reach)[:, None] * 1.7)


@law(*SIGHT)
def curved_scale(s: Scene) -> Moved:
    """Add a scale error of the tracker that grows with the square of the range.

    It was set with a short distance.
    """
    along, distance = s.beam
    far = (distance - distance.mean()) / distance.std()
    return Moved(point=along * (far**2 - 0.3 * far**3)[:, None])


@law(*TIME)
def meter_jumps(s: Scene) -> Moved:
    """Add a step along the beam at six moments.

    After each broken beam the distance meter comes back a little off.
    """
    along, _ = s.beam
    begins = np.sort(s.rng.random(6))
    level = s.rng.normal(size=7)[np.searchsorted(begins, s.share)]
    return Moved(point=along * level[:, None] * 1.7)


@law(*TIME)
def two_time_constants(s: Scene) -> Moved:
    """Warm the upper arm in ten minutes and the column in two hours, with opposite errors."""
    driven = s.air - s.air[0] + 3.0 * (1.0 - np.exp(-s.time / 900.0)) * (1.0 + 0.5 * np.sin(s.time / 2700.0))
    quick, slow = relaxed(driven, s.time, 600.0), relaxed(driven, s.time, 7200.0)
    return Moved({2: quick - 1.5 * slow, 1: 0.8 * slow - 0.5 * quick}, lean=np.outer(quick, [0.0, 0.3, 0.0]))


@law(*TIME)
def sinking_tripod(s: Scene) -> Moved:
    """Lean the instrument's stand, which is noticed, set upright, and leans again."""
    saw = (3.0 * s.share) % 1.0
    lean = np.outer(saw**1.5, s.direction())
    return Moved(point=np.cross(lean, s.place - s.station) / s.arm.reach * 3.0)


@law(*TIME)
def noise_that_lasts(s: Scene) -> Moved:
    """Air in front of the beam: noise across it, kept to 0.85 from one reading to the next."""
    along, _ = s.beam
    across = np.cross(along, [0.0, 0.0, 1.0])
    return Moved(
        point=across * red_noise(s, 0.85)[:, None] * 1.2 + np.outer(red_noise(s, 0.85), [0.0, 0.0, 1.2])
    )


@law(*TIME)
def machine_next_door(s: Scene) -> Moved:
    """Tilt the floor on and off, five times, as by a press next to the cell.

    The press works in day and night shifts.
    """
    on = np.sin(2.0 * np.pi * (5.0 * s.share + s.rng.random())) > 0.3
    return Moved(lean=np.outer(on.astype(np.float64), [0.8, -0.6, 0.0]))


@law(*TIME, "joint 2")
def gives_way_once(s: Scene) -> Moved:
    """Displace joint 2 by a blow; half of it remains.

    The other half decays within a tenth of the campaign.
    """
    late = np.maximum(s.share - s.rng.uniform(0.25, 0.6), 0.0)
    return Moved({2: np.where(late > 0.0, 1.0 + np.exp(-late / 0.05), 0.0)})


@law("tool target", "side of the tool", "direction of the tool", *JOINTS)
def ball_rolls(s: Scene) -> Moved:
    """Turn the reflector of one target in its nest with the line of sight.

    Its centre is off the centre of its ball.
    """
    along, _ = s.beam
    seen = np.einsum("nji,nj->ni", s.flange[:, :3, :3], along)
    return Moved(tool=np.where((s.target == 1)[:, None], seen * 4.0 * seen[:, :1], 0.0))
