"""Exact kinematic chain, batched: from slot values to the target frame and all twists.

The chain is a row of elementary motions, each a turn about or a shift along one axis of the frame that the
motions before it have made. Each has a name, its *slot*:

    frame.x .. frame.rz    the instrument's frame, turning about the station
    base.x .. base.rz      the base of the series (behind its constant placement in the world)
    alphaK aK thetaK dK betaK   link K: Rx(alpha) Ry(beta) Tx(a) Rz(theta) Tz(d)  (modified DH), or
                                        Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)  (standard DH)
    bearingK.rx, bearingK.ry    the bearing of joint K, tilting about the joint's origin just before theta_K: the
                                origin of frame K (modified DH, where Tz(d) may as well come before
                                Rz(theta)),
                                of frame K-1 (standard DH)
    bearingK.x, bearingK.y      of a joint that slides: its carriage, aside of the axis; there all four come just behind
                                d_K, so that they act where the carriage is, and theta_K is its roll
    tool.x .. tool.rz      the tool at the flange
    target.x .. target.rz  the measured target on the tool; its turns move no point, only its orientation
    anchor.x .. anchor.z   outside the chain, in the world: the base target to which a distance was measured
    length.zero            what a length meter shows at zero distance

Arrays hold one reading per column, so every product runs over all readings at once: vectors are (3, n).

The module also computes gravity torques, the scaled Jacobian of the nominal tool point, and small
differences of poses.

Sources: Craig's and Denavit's conventions, Hayati 1983 for beta, Nubiola, Annex I (I.2) for the base.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from calib.arm.robot import BasePlacement, Convention, Load, Robot
from calib.array import Array

LEVER_MM = 300.0
"""Length that turns an error of orientation into one of position, and a turn of a joint into a slide: about a link."""


@dataclass(frozen=True)
class MotionStep:
    """An elementary motion: `slot` turns about (`turns`) or shifts along axis 0, 1 or 2."""

    slot: str
    turns: bool
    axis: int


def _six(name: str) -> tuple[MotionStep, ...]:
    return tuple(
        MotionStep(f"{name}.{'r' if turns else ''}{'xyz'[k]}", turns, k)
        for turns in (False, True)
        for k in range(3)
    )


def _link(convention: Convention, k: int, slides: bool) -> tuple[MotionStep, ...]:
    alpha, beta = MotionStep(f"alpha{k}", True, 0), MotionStep(f"beta{k}", True, 1)
    a, theta, d = (
        MotionStep(f"a{k}", False, 0),
        MotionStep(f"theta{k}", True, 2),
        MotionStep(f"d{k}", False, 2),
    )
    bearing = MotionStep(f"bearing{k}.rx", True, 0), MotionStep(f"bearing{k}.ry", True, 1)
    if slides:  # Rz(theta) and Tz(d) may change places
        joint = (
            d,
            MotionStep(f"bearing{k}.x", False, 0),
            MotionStep(f"bearing{k}.y", False, 1),
            *bearing,
            theta,
        )
        return (alpha, beta, a, *joint) if convention == "mdh" else (*joint, a, alpha, beta)
    if convention == "mdh":
        return (alpha, beta, a, d, *bearing, theta)
    return (*bearing, theta, d, a, alpha, beta)


FRAME = _six("frame")
TOOL = _six("tool")
TARGET = _six("target")
ANCHOR = tuple(motion.slot for motion in _six("anchor")[:3])
LENGTH_ZERO = "length.zero"
BESIDE = (*ANCHOR, LENGTH_ZERO)


@dataclass(frozen=True)
class Chain:
    """Elementary motions of one robot: `base`, and `links` with one tuple per link."""

    base: tuple[MotionStep, ...]
    links: tuple[tuple[MotionStep, ...], ...]

    @staticmethod
    def of(robot: Robot) -> Chain:
        """Return the chain of `robot`; Nubiola (thesis I.2) puts d_1 before the base rotations."""
        return _chain(robot.convention, robot.base, robot.joints, robot.slides)

    @property
    def slots(self) -> dict[str, MotionStep]:
        """Every slot of the chain by name, in order from world to target.

        The slots outside the chain (`BESIDE`) are not included.
        """
        motions = (*FRAME, *self.base, *(m for link in self.links for m in link), *TOOL, *TARGET)
        return {motion.slot: motion for motion in motions}


@cache
def _chain(convention: Convention, placement: BasePlacement, joints: int, slides: tuple[int, ...]) -> Chain:
    base = _six("base")
    links = [_link(convention, k, k in slides) for k in range(1, joints + 1)]
    if placement == "thesis":
        d1 = MotionStep("d1", False, 2)
        base = (*base[:3], d1, *base[3:])
        links[0] = tuple(motion for motion in links[0] if motion != d1)
    return Chain(base, tuple(links))


@dataclass
class Frames:
    """Frames at the end of a chain.

    Attributes
    ----------
    x, y, z, p : array of shape (3, n) or (3, 1)
        Columns of the rotation, and the origin, mm.
    anchor : array of shape (3, n) or (3, 1)
        Base target of every reading, mm.
    world : tuple of array
        Axes of the frame in which `anchor` is given.
    length_zero : array of shape (n,) or float
        What a length meter shows at zero distance, mm.
    record : collection of str or None
        Slots whose axis and origin are kept; None for all.
    """

    x: Array
    y: Array
    z: Array
    p: Array
    anchor: Array = field(default_factory=lambda: np.zeros((3, 1)))
    world: tuple[Array, Array, Array] | None = None
    length_zero: Array | float = 0.0
    record: Collection[str] | None = None
    axis: dict[str, Array] = field(default_factory=dict)
    origin: dict[str, Array] = field(default_factory=dict)
    turns: dict[str, bool] = field(default_factory=dict)
    link_frames: list[tuple[Array, Array, Array, Array]] = field(default_factory=list)

    def twist(self, slot: str) -> tuple[Array, Array]:
        """Velocity of the target point and angular velocity, both (3, n), for a unit rate of `slot`."""
        axis = self.axis[slot]
        if not self.turns[slot]:
            return axis, np.zeros((3, 1))
        return cross(axis, self.p - self.origin[slot]), axis

    def velocities(self, slots: Sequence[str]) -> Array:
        """Return the velocities of the target point for a unit rate of slots, shape (S, 3, n).

        They are 0 for slots outside the chain.
        """
        axes, turning = self._axes(slots)
        arms = np.empty((len(turning), *axes.shape[1:]))
        for i, s in enumerate(turning):
            np.subtract(self.p, self.origin[slots[s]], out=arms[i])
        axes[turning] = cross(axes[turning], arms)
        return axes

    def turnings(self, slots: Sequence[str]) -> Array:
        """Return the angular velocities of the target frame for a unit rate of slots, (S, 3, n)."""
        axes, turning = self._axes(slots)
        sliding = np.ones(len(slots), dtype=bool)
        sliding[turning] = False
        axes[sliding] = 0.0
        return axes

    def _axes(self, slots: Sequence[str]) -> tuple[Array, list[int]]:
        """Return the axes (S, 3, n) of some slots, and which of them turn."""
        n = max(v.shape[1] for v in (self.x, self.y, self.z, self.p))
        axes = np.zeros((len(slots), 3, n))
        turning = []
        for i, slot in enumerate(slots):
            if slot in self.axis:
                axes[i] = self.axis[slot]
                if self.turns[slot]:
                    turning.append(i)
        return axes, turning

    @property
    def rotation(self) -> Array:
        """Rotations of the target frame in the world, shape (n, 3, 3)."""
        (n,) = np.broadcast_shapes(*(v.shape[1:] for v in (self.x, self.y, self.z, self.p)))
        columns = [np.broadcast_to(v, (3, n)) for v in (self.x, self.y, self.z)]
        return np.stack(columns, axis=-1).transpose(1, 0, 2)

    def _go(self, motions: Sequence[MotionStep], values: Mapping[str, Array | float]) -> None:
        """Move along a row of motions."""
        # Local names and no function call for each motion: with few readings Python takes most of the time.
        # Arrays are replaced, never changed in place: what `axis` and `origin` refer to stays valid.
        columns, p, record = [self.x, self.y, self.z], self.p, self.record
        for motion in motions:
            slot, axis = motion.slot, motion.axis
            if record is None or slot in record:
                self.axis[slot], self.origin[slot], self.turns[slot] = columns[axis], p, motion.turns
            if slot not in values:
                continue
            value = values[slot]
            one = isinstance(value, float)
            if one and value == 0.0:
                continue
            if not motion.turns:
                p = p + columns[axis] * value
                continue
            c, s = (math.cos(value), math.sin(value)) if one else (np.cos(value), np.sin(value))
            u, v = columns[axis - 2], columns[axis - 1]
            columns[axis - 2], columns[axis - 1] = u * c + v * s, v * c - u * s
        self.x, self.y, self.z = columns
        self.p = p

    def _shift(self, vector: Array) -> None:
        self.p = self.p + self.x * vector[0] + self.y * vector[1] + self.z * vector[2]

    def _place(self, rotation: Array, translation: Array) -> None:
        """Compose with constants: rotation (3, 3, n or 1), translation (3, n or 1)."""
        x, y, z = self.x, self.y, self.z
        if rotation.shape[2] == translation.shape[1] == x.shape[1] == y.shape[1] == z.shape[1] == 1:
            axes = np.concatenate((x, y, z), axis=1)
            self.p = self.p + axes @ translation
            turned = axes @ rotation[:, :, 0]
            self.x, self.y, self.z = turned[:, :1], turned[:, 1:2], turned[:, 2:]
            return
        self._shift(translation)
        self.x = x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0]
        self.y = x * rotation[0, 1] + y * rotation[1, 1] + z * rotation[2, 1]
        self.z = x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2]


def cross(u: Array, v: Array) -> Array:
    """Compute the cross product of (..., 3, n) arrays along the last axis but one.

    It is several times faster than `numpy.cross`.
    """
    ux, uy, uz = u[..., 0, :], u[..., 1, :], u[..., 2, :]
    vx, vy, vz = v[..., 0, :], v[..., 1, :], v[..., 2, :]
    out = np.empty(np.broadcast_shapes(u.shape, v.shape))
    for row, (a, b, c, d) in enumerate(((uy, vz, uz, vy), (uz, vx, ux, vz), (ux, vy, uy, vx))):
        np.multiply(a, b, out=out[..., row, :])
        out[..., row, :] -= c * d
    return out


@dataclass(frozen=True)
class BasePoses:
    """Constant poses of the base in the world, for every reading or for all.

    `rotation` is (3, 3, n or 1), `translation` (3, n or 1), mm.
    """

    rotation: Array = field(default_factory=lambda: np.eye(3)[:, :, None])
    translation: Array = field(default_factory=lambda: np.zeros((3, 1)))


def propagate(
    chain: Chain,
    values: Mapping[str, Array | float],
    placement: BasePoses,
    station: Array | None = None,
    record: Collection[str] | None = None,
    turn: Array | None = None,
) -> Frames:
    """Carry frames through the chain.

    Parameters
    ----------
    values : mapping of str to array of shape (n,) or float
        Value of each slot, rad or mm. An absent slot is zero.
    placement : BasePoses
        Constant pose of the base in the world.
    station : array of shape (3,), optional
        Point about which the instrument's frame turns, mm. Default: the origin.
    record : collection of str, optional
        Slots whose axis is kept. Default: all.
    turn : array of shape (3, 3, n or 1), optional
        Constant orientation of the tool frame, behind the target's position.

    Returns
    -------
    Frames
        Frame of the target, and the axis of every recorded slot that was passed.
    """
    eye = np.eye(3)
    centre = np.zeros((3, 1)) if station is None else np.asarray(station, dtype=np.float64).reshape(3, 1)
    wanted = None if record is None else frozenset(record)
    frames = Frames(eye[:, :1], eye[:, 1:2], eye[:, 2:], centre, record=wanted)
    frames._go(FRAME, values)
    frames._shift(-centre)
    frames.world = (frames.x, frames.y, frames.z)
    x, y, z = (values.get(slot, 0.0) for slot in ANCHOR)
    here = isinstance(x, float) and isinstance(y, float) and isinstance(z, float) and x == y == z == 0.0
    frames.anchor = frames.p if here else frames.p + frames.x * x + frames.y * y + frames.z * z
    frames.length_zero = values.get(LENGTH_ZERO, 0.0)
    frames._place(placement.rotation, placement.translation)
    frames._go(chain.base, values)
    for link in chain.links:
        frames._go(link, values)
        frames.link_frames.append((frames.x, frames.y, frames.z, frames.p))
    frames._go(TOOL, values)
    frames._go(TARGET[:3], values)
    if turn is not None:
        frames._place(turn, np.zeros((3, 1)))
    frames._go(TARGET[3:], values)
    return frames


def nominal_values(robot: Robot, joints: Array) -> dict[str, Array | float]:
    """Slot values of the nominal robot at model joints (n, N), rad, or mm of those that slide."""
    values: dict[str, Array | float] = {}
    for k in range(robot.joints):
        values[f"alpha{k + 1}"] = robot.alpha[k]
        values[f"a{k + 1}"] = robot.a[k]
        values[f"theta{k + 1}"] = robot.theta[k]
        values[f"d{k + 1}"] = robot.d[k]
    for k, slot in enumerate(robot.joint_slots):
        values[slot] = joints[:, k] + values[slot]
    return values


def forward(robot: Robot, joints: Array) -> Array:
    """Compute the flange poses of the nominal robot in the base frame.

    `joints` (n, N) are model joints, rad or mm. The poses are (n, 4, 4), mm.
    """
    frames = propagate(Chain.of(robot), nominal_values(robot, joints), BasePoses(), record=())
    poses = np.zeros((len(joints), 4, 4))
    poses[:, :3, :3] = frames.rotation
    poses[:, :3, 3] = frames.p.T
    poses[:, 3, 3] = 1.0
    return poses


@dataclass(frozen=True)
class Statics:
    """Gravity torques on the arm at nominal geometry, N.mm.

    Attributes
    ----------
    moment : array of shape (n, N, 3)
        Moment of all loads beyond joint K about its origin, in the axes of the frame just before
        theta_K. For a joint that slides, the third component is the force of gravity along its axis, N.
    overturning : array of shape (n, 3)
        Moment of all loads about the origin of the base, in its axes.
    unit_load : array of shape (n, N, 4)
        Torque about every joint of 1 kg at the origin of the last link's frame, then of 1 kg mm along
        its x, y and z. The torque of any load on the last link is linear in mass and mass x centre.
    """

    moment: Array
    overturning: Array
    unit_load: Array

    @property
    def torque(self) -> Array:
        """Torque about each joint, or force along it, N, shape (n, N).

        It is positive in the direction in which gravity pushes.
        """
        return self.moment[:, :, 2]


def statics(
    robot: Robot,
    joints: Array,
    loads: tuple[Load, ...] | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
) -> Statics:
    """Compute the moments of gravity at model joints (n, N), rad or mm.

    M_i is the sum of (c_j - o_i) x (m_j g) over the loads beyond joint i, computed from the last joint
    inwards. The origin o_i is that of frame i (modified DH) or i-1 (standard DH). `loads` replaces those
    of the robot; `gravity` (3,) is in the base frame, m/s2. Source: Nubiola, Annex I.
    """
    frames = propagate(Chain.of(robot), nominal_values(robot, joints), BasePoses())
    n, count = joints.shape
    g = np.array(gravity)[:, None]
    moment, unit_load = np.zeros((n, count, 3)), np.zeros((n, count, 4))
    # Sum of the loads beyond the joint, and of mass x place.
    mass, weighed = 0.0, np.zeros((3, n))
    *last_axes, last_origin = frames.link_frames[-1]
    for k in range(count, 0, -1):
        for load in robot.loads if loads is None else loads:
            if load.link == k:
                x, y, z, p = frames.link_frames[k - 1]
                centre = p + x * load.cog_mm[0] + y * load.cog_mm[1] + z * load.cog_mm[2]
                mass, weighed = mass + load.mass_kg, weighed + load.mass_kg * centre
        origin, axis = frames.origin[f"theta{k}"], frames.axis[f"theta{k}"]
        about = cross(weighed - mass * origin, g)
        for i, slot in enumerate((f"bearing{k}.rx", f"bearing{k}.ry", f"theta{k}")):
            moment[:, k - 1, i] = np.sum(frames.axis[slot] * about, axis=0)
        if k in robot.slides:
            along = np.sum(axis * g, axis=0)
            moment[:, k - 1, 2], unit_load[:, k - 1, 0] = mass * along, along
            continue
        swing = cross(g, axis)  # z . (r x g) = r . (g x z)
        for i, lever in enumerate((last_origin - origin, *last_axes)):
            unit_load[:, k - 1, i] = np.sum(lever * swing, axis=0)
    return Statics(moment, np.broadcast_to(cross(weighed, g), (3, n)).T.copy(), unit_load)


def gravity_torques(
    robot: Robot,
    joints: Array,
    loads: tuple[Load, ...] | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
) -> Array:
    """Compute the gravity torques of the joints.

    tau_i = z_i . M_i (see `statics`), which equals -dU/dq. Source: Nubiola, Annex I.

    Parameters
    ----------
    joints : array of shape (n, N)
        Model joints, rad or mm.
    loads : tuple of Load, optional
        Default: those of the robot.
    gravity : tuple of float, optional
        In the base frame, m/s2.

    Returns
    -------
    array of shape (n, N)
        Torque about each joint, N.mm, or force along a joint that slides, N. It is positive in the
        direction in which gravity pushes.
    """
    return statics(robot, joints, loads, gravity).torque


def gravity_at_flange(
    robot: Robot, joints: Array, gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
) -> Array:
    """Return the direction of gravity in the axes of the last link, shape (n, 3).

    `joints` (n, N) are model angles of the nominal robot, rad.
    """
    frames = propagate(Chain.of(robot), nominal_values(robot, joints), BasePoses(), record=())
    pull = np.array(gravity)[:, None]
    across = [np.sum(axis * pull, axis=0) for axis in frames.link_frames[-1][:3]]
    down = np.array([np.broadcast_to(a, len(joints)) for a in across]).T
    return down / max(float(np.linalg.norm(pull)), 1e-300)


def pose_difference(wanted: Array, reached: Array) -> Array:
    """Compute the small differences from poses `reached` to poses `wanted`, shape (n, 6).

    Both poses are (n, 4, 4). A difference is the shift in mm and the turn as a rotation vector in rad,
    in world axes. The turn is exact to second order and is zero only if the orientations agree, which is
    enough for small differences.
    """
    turn = wanted[:, :3, :3] @ reached[:, :3, :3].transpose(0, 2, 1)
    vector = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], axis=1
    )
    return np.hstack([wanted[:, :3, 3] - reached[:, :3, 3], vector])


def nominal_jacobian(robot: Robot, joints: Array, tool: Array) -> tuple[Array, Array]:
    """Compute the poses and the scaled Jacobian of the nominal tool point.

    Parameters
    ----------
    joints : array of shape (n, N)
        Model joints, rad or mm.
    tool : array of shape (3,)
        Tool point in the flange frame, mm.

    Returns
    -------
    poses : array of shape (n, 4, 4)
        Poses of the tool point, mm.
    jacobian : array of shape (n, 6, N)
        Rows in mm per rad or per mm; those of rotation are multiplied by `LEVER_MM`.
    """
    n = len(joints)
    values = nominal_values(robot, joints) | {
        f"target.{axis}": float(x) for axis, x in zip("xyz", tool, strict=True)
    }
    frames = propagate(Chain.of(robot), values, BasePoses())
    poses = np.zeros((n, 4, 4))
    poses[:, :3, :3] = frames.rotation
    poses[:, :3, 3] = np.broadcast_to(frames.p, (3, n)).T
    poses[:, 3, 3] = 1.0
    jacobian = np.zeros((n, 6, robot.joints))
    for k, slot in enumerate(robot.joint_slots):
        linear, angular = frames.twist(slot)
        jacobian[:, :3, k] = np.broadcast_to(linear, (3, n)).T
        jacobian[:, 3:, k] = LEVER_MM * np.broadcast_to(angular, (3, n)).T
    return poses, jacobian


def joint_scale(robot: Robot) -> Array:
    """Return the motion of each joint that is comparable with a turn by 1 rad, shape (N,).

    It is 1 rad for a joint that turns, and `LEVER_MM` for one that slides.
    """
    return np.where([kind == "slides" for kind in robot.kinds], LEVER_MM, 1.0)
