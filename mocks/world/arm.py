"""One reading of the arm: what is known about it, and the working copy that hidden effects act on."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mocks.world.air import Air
from mocks.world.kinematics import Geometry
from mocks.world.robots import Load, Robot
from mocks.world.transforms import Matrix, Vector


@dataclass(frozen=True)
class ArmState:
    """The conditions of one reading, as the cell knows them.

    `joints_deg` commanded angles, `previous_deg` the angles before the last move, `sides` +1 per joint that
    arrived from below and -1 from above, `t_s` seconds since the start, `t_air_c` air temperature,
    `reading` the order of the reading in the campaign, 0-based.
    """

    joints_deg: tuple[float, ...]
    previous_deg: tuple[float, ...]
    sides: tuple[int, ...]
    t_s: float = 0.0
    t_air_c: float = 22.0
    reading: int = 0


@dataclass
class Arm:
    """The working copy of one reading. Effects change it in place; then the chain is evaluated.

    Angles rad, lengths mm, moments N.mm in the base frame, torques N.mm. `extra_angle` is added to the joints (rad,
    mm of those that slide), `lean` and `tilts` are rotation vectors (see kinematics.frames), `shove` moves the whole
    robot in the world, `tool` moves all targets in the flange frame, `target_shift` single ones.
    """

    state: ArmState
    robot: Robot
    angles: list[float]
    previous: list[float]
    geometry: Geometry
    loads: list[Load]
    nominal_chain: list[Matrix]
    t_mean_c: float
    air_c: Air
    extra_angle: list[float]
    moments: list[Vector] = field(default_factory=list)
    torques: list[float] = field(default_factory=list)
    overturning: Vector = field(default_factory=lambda: np.zeros(3))
    lean: Vector | None = None
    tilts: dict[int, Vector] = field(default_factory=dict)
    shove: Matrix | None = None
    tool: Matrix | None = None
    target_shift: dict[str, Vector] = field(default_factory=dict)


@dataclass
class Sight:
    """One point on its way to the instrument's display: `point` (3,) mm in the world, seen from `station`."""

    state: ArmState
    point: Vector
    station: Vector
