"""Laws of gears, cables, links and loads.

JOINTS are the places reported for a law that is smooth in the joints.
"""

from __future__ import annotations

import numpy as np

from tests.benchmarks.strangers.arms import Array
from tests.benchmarks.strangers.scene import Moved, Scene, law

JOINTS = ("joint", "region", "direction of the tool")
LOADS = ("torque", "moment", "overturning")
ARRIVAL = ("side of approach", "last move", "last change")


@law(*JOINTS)
def smooth_in_two_joints(s: Scene) -> Moved:
    """Turn joint 2 by a field over joints 1 and 2, because its casting yields.

    The field is as wide as 40 deg and periodic over a turn.
    """
    turned = np.column_stack([np.cos(s.angles[:, :2]), np.sin(s.angles[:, :2])])
    return Moved({2: s.field(turned, 0.7, 1)[:, 0]})


@law(*JOINTS, wrist=True)
def smooth_in_the_wrist(s: Scene) -> Moved:
    """A hose bundle pushes the flange about by the last three joints."""
    return Moved(tool=s.field(s.angles[:, -3:], 1.1, 3))


@law(*JOINTS, wrist=True)
def bevel_gears(s: Scene) -> Moved:
    """Bevel wheels of a hollow wrist: the last joint errs where two wheels meet, by 3 q5 - 2 q4."""
    return Moved({6: np.sin(3.0 * s.angles[:, 4] - 2.0 * s.angles[:, 3] + 0.4)})


@law("side of approach of joint 2", "last move of joint 2", *ARRIVAL)
def play_of_a_neighbour(s: Scene) -> Moved:
    """Turn joint 1 by the side from which joint 2 comes.

    The motor of joint 2 sits on the housing of joint 1's gear.
    """
    return Moved({1: s.side[:, 1] * (1.0 + 0.4 * np.sin(s.angles[:, 1]))})


@law(*ARRIVAL)
def root_of_the_move(s: Scene) -> Moved:
    """Dry friction: joint 1 stops short by the root of the way that it came."""
    way = s.angles[:, 0] - s.arm.usual(s.before)[:, 0]
    return Moved({1: -np.sign(way) * np.sqrt(np.abs(way)) * (0.6 + 0.4 * np.cos(2.0 * s.angles[:, 0]))})


@law("joint 2 angle", *ARRIVAL)  # an element of 60 deg follows the angle for most of the way
def remembering_gear(s: Scene) -> Moved:
    """Hold slipping elements of 3, 20 and 60 deg in joint 2.

    Their state depends on all earlier reversals.
    """
    held = np.zeros(3)
    width = np.radians([3.0, 20.0, 60.0])
    way = np.column_stack([s.arm.usual(s.before)[:, 1], s.angles[:, 1]])
    out = np.empty(s.count)
    at = way[0, 0]
    for i, (begin, end) in enumerate(way):  # the past decides, so one after the other
        for there in (begin, end):
            held = np.clip(held + there - at, -width / 2.0, width / 2.0)
            at = there
        out[i] = np.sum(held / width * [1.0, 1.2, 1.4])
    return Moved({2: out})


@law("time", "temperature", "joint 1")
def slipping_coupling(s: Scene) -> Moved:
    """A clamp of joint 1 slips a little at some fast moves, either way, and never comes back."""
    slips = s.rng.random(s.count) < 8.0 / s.count
    return Moved({1: np.cumsum(np.where(slips, s.rng.normal(size=s.count), 0.0)) * 1.5})


@law("joint 3", "joint 2 and joint 3", *JOINTS)
def cable_goes_taut(s: Scene) -> Moved:
    """Pull joint 1's cover by a cable that goes taut when joints 2 and 3 both lie back."""
    taut = np.maximum(0.0, 0.8 * s.angles[:, 1] + s.angles[:, 2] - np.median(s.angles[:, 2]))
    return Moved({1: taut**2 * 1.5})


@law(*LOADS, *JOINTS, bend=True)
def soft_then_hard(s: Scene) -> Moved:
    """Wind up joint 3's flexspline, softly under the first third of its load.

    The wind-up also depends on the position of its teeth.
    """
    wound = np.sign(s.torque[:, 2]) * (1.0 - np.exp(-np.abs(s.torque[:, 2]) / 0.3))
    return Moved({3: wound * (1.0 + 0.7 * np.cos(2.0 * s.angles[:, 2] + 1.0))})


@law(*LOADS, *JOINTS, bend=True)
def weak_sector(s: Scene) -> Moved:
    """Make joint 2 softer in one sector of joint 1, at the door of the column."""
    return Moved({2: s.torque[:, 1] * np.exp(-((np.sin(0.5 * (s.angles[:, 0] - 0.8)) / 0.35) ** 2)) * 2.0})


@law(*LOADS, *JOINTS, bend=True)
def product_of_loads(s: Scene) -> Moved:
    """The elbow leans aside by the product of the torques of joints 2 and 3."""
    return Moved({4: 2.0 * s.torque[:, 1] * s.torque[:, 2]})


@law("overturning", "joint 1", "region", *LOADS, *JOINTS, bend=True)
def rocking_base(s: Scene) -> Moved:
    """Rock the base over to the side of the load, so that it has two positions.

    One of its three feet is not screwed down.
    """
    foot = s.rng.uniform(-np.pi, np.pi)
    over = np.cos(foot) * s.overturning[:, 0] + np.sin(foot) * s.overturning[:, 1]
    rocked = np.tanh((over - np.median(over)) / 0.1)
    return Moved(lean=rocked[:, None] * np.array([np.cos(foot), np.sin(foot), 0.0]))


@law("direction of the tool", "side of the tool", "tool target and the side", *LOADS, *JOINTS, bend=True)
def tool_bends_by_the_square(s: Scene) -> Moved:
    """Bend a slim tool sideways by the square of the weight across it, more further out."""
    lever = np.linalg.norm(s.targets, axis=1)[s.target] / 100.0
    across = s.down[:, :2]
    shift = across * np.abs(across) * lever[:, None] ** 2
    return Moved(tool=np.column_stack([shift, np.zeros(s.count)]))


@law("direction of the tool", "side of the tool", "tool target and the side", *LOADS, *JOINTS, bend=True)
def tool_twists(s: Scene) -> Moved:
    """A gripper turns about the flange's axis by the product of the weights along its two sides."""
    turn = 2.0 * s.down[:, 0] * s.down[:, 1]
    place = s.targets[s.target] / 100.0
    return Moved(tool=np.column_stack([-place[:, 1] * turn, place[:, 0] * turn, np.zeros(s.count)]))


@law("direction of the tool", "side of the tool", "tool target and the side", *LOADS, *JOINTS, bend=True)
def falling_jaw(s: Scene) -> Moved:
    """A jaw slides to whichever end is down, but only when it leans by 20 deg."""
    axis = s.direction()
    return Moved(tool=np.clip(s.down @ axis / np.sin(np.radians(20.0)), -1.0, 1.0)[:, None] * axis)


@law("time since the last move", *ARRIVAL, *LOADS, *JOINTS, bend=True)
def creep_after_arrival(s: Scene) -> Moved:
    """Let joint 2 yield after it came to rest, by the logarithm of its time under load."""
    stood = np.log1p(np.diff(s.time, prepend=s.time[0] - 20.0) / 10.0)
    return Moved({2: (stood - stood.mean()) * (0.3 + s.torque[:, 1])})


@law("joint", "region", "direction", "last move", "overturning")
def spring_to_the_ceiling(s: Scene) -> Moved:
    """Pull the hand by a balancer that hangs above the cell.

    It pulls once its rope is out by more than half the reach.
    """
    hook = np.array([0.5, 0.3, 1.6]) * s.arm.reach
    way = hook - s.place
    length = np.linalg.norm(way, axis=1)
    force = np.maximum(0.0, length - np.quantile(length, 0.4)) / np.ptp(length)
    return Moved(point=_of(way / length[:, None], 3.0 * force))


def _of(directions: Array, size: Array) -> Array:
    return directions * size[:, None]
