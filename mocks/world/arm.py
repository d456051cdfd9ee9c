"""One reading of the arm: its known conditions, and the copy that hidden effects change."""

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

    Attributes
    ----------
    joints_deg : tuple of float
        Commanded angles.
    previous_deg : tuple of float
        Angles before the last move.
    sides : tuple of int
        +1 for each joint that arrived from below, -1 from above.
    t_s : float
        Seconds since the start.
    t_air_c : float
        Air temperature, degC.
    reading : int
        Order of the reading in the campaign, 0-based.
    """

    joints_deg: tuple[float, ...]
    previous_deg: tuple[float, ...]
    sides: tuple[int, ...]
    t_s: float = 0.0
    t_air_c: float = 22.0
    reading: int = 0


@dataclass
class Arm:
    """The working copy of one reading.

    Effects change it in place; then the chain is evaluated. Angles are in rad, lengths in mm, moments in N.mm in
    the base frame, torques in N.mm. `extra_angle` is added to the joints (rad, mm for sliding ones). `lean` and
    `tilts` are rotation vectors (see kinematics.frames). `shove` moves the whole robot in the world, `tool` moves
    all targets in the flange frame, and `target_shift` moves single ones.
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
    """One point on its way to the instrument's display.

    `point` (3,) is in mm in the world, seen from `station`.
    """

    state: ArmState
    point: Vector
    station: Vector
