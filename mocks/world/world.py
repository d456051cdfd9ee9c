"""The simulated physical truth of one cell: a real arm, its hidden effects, and its tracker.

World -> base -> links 1..N -> flange -> target.

    joint = commanded joint + c tau + hidden effects (+ repeatability in a measured reading)

tau is taken on the nominal geometry at the commanded joints (Nubiola's thesis, Annex I), with the true loads.
Lengths are in mm, angles in deg in states and rad inside.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from mocks.world.air import MEAN_C, draw_air
from mocks.world.arm import Arm, ArmState, Sight
from mocks.world.catalogue import build, group_of
from mocks.world.draw import Material, Session, true_compliance, true_geometry
from mocks.world.effect import Effect, number_of
from mocks.world.gravity import moments, overturning_moment, torques
from mocks.world.kinematics import axis_frame, frames, nominal_geometry
from mocks.world.noise import TrackerNoise
from mocks.world.robots import TRIANGULAR_TARGETS, Load, Robot, robot_named
from mocks.world.scaling import rehearsal, scaled
from mocks.world.transforms import Matrix, Vector, place

Point = tuple[float, float, float]

STATION_MM = (2400.0, -900.0, 350.0)
REPEATABILITY_DEG, REPEATABILITY_MM = 0.0008, 0.003

# Independent random streams of one seed, so that asking for another effect does not change the robot.
ROBOT_STREAM, AIR_STREAM, EFFECT_STREAM, NOISE_STREAM, POSE_STREAM, LABEL_STREAM, ARRIVAL_STREAM = range(7)


def stream(seed: int, number: int) -> np.random.Generator:
    """Return the random stream `number` of `seed`."""
    return np.random.default_rng([seed, number])


def declared_loads(robot: Robot, mass_kg: float | None, cog_mm: Point | None) -> list[Load]:
    """Return the robot's loads with mass and centre (flange frame) of its tool replaced.

    The tool is the load that the thesis's robots carry on their last link. Other robots carry none, and the tool is
    added.
    """
    loads = list(robot.loads)
    if mass_kg is None and cog_mm is None:
        return loads
    if robot.carries_tool:
        tool = loads.pop()
        mass_kg, cog_mm = tool.mass_kg if mass_kg is None else mass_kg, cog_mm or tool.cog_mm
    if mass_kg is None or cog_mm is None:
        raise ValueError("this robot carries no tool: give both tool_mass_kg and tool_cog_mm")
    return [*loads, Load(len(robot.links), mass_kg, cog_mm)]


class World:
    """One arm drawn from `seed`, its hidden `effects`, and a laser tracker at `station_mm`.

    `effects` are Effect objects, or labels. Labels are drawn from the seed and scaled so that each displaces the
    points of 100 random poses by `size` times the noise (RMS per axis). `misplaced_mm` is the error of the places
    in `targets`, in the flange frame. `session` is the length of the campaign, for steps, drifts and lags.
    """

    def __init__(
        self,
        robot: str | Robot = "abb-irb120",
        seed: int = 1,
        effects: Sequence[str | Effect] | None = None,
        *,
        size: float = 3.0,
        departure: str | None = None,
        station_mm: Sequence[float] = STATION_MM,
        targets: Mapping[str, Sequence[float]] | None = None,
        misplaced_mm: Mapping[str, Sequence[float] | Vector] | None = None,
        tool_mass_kg: float | None = None,
        tool_cog_mm: Point | None = None,
        noise: TrackerNoise | None = None,
        repeatability_deg: float = REPEATABILITY_DEG,
        repeatability_mm: float = REPEATABILITY_MM,
        session: Session | None = None,
    ) -> None:
        self.robot = robot_named(robot) if isinstance(robot, str) else robot
        self.seed = seed
        self.session = session or Session()
        self.station = np.array(station_mm, dtype=float)
        self.targets = {name: tuple(map(float, p)) for name, p in (targets or TRIANGULAR_TARGETS).items()}
        self.misplaced = {name: np.array(off, dtype=float) for name, off in (misplaced_mm or {}).items()}
        self.noise = noise or TrackerNoise()
        self.repeatability_deg = repeatability_deg
        self._scatter = np.where(self.robot.sliding, repeatability_mm, math.radians(repeatability_deg))
        self.loads = declared_loads(self.robot, tool_mass_kg, tool_cog_mm)
        rng = stream(seed, ROBOT_STREAM)
        self.geometry = true_geometry(self.robot, rng)
        self.compliance = true_compliance(self.robot, rng)
        self.air_c = draw_air(stream(seed, AIR_STREAM), self.session.duration_s)
        self._noise_rng = stream(seed, NOISE_STREAM)
        self._effect_rng = stream(seed, EFFECT_STREAM)
        self._nominal_geometry = nominal_geometry(self.robot)
        self._nominal = lru_cache(maxsize=4096)(self._nominal_statics)
        self.effects: list[Effect] = []
        labels = [e for e in effects or () if isinstance(e, str)]
        if labels:
            readings = rehearsal(self)
            drawn = {e: scaled(self, self.draw_effect(e, departure), readings, size) for e in labels}
            self.effects = [drawn[e] if isinstance(e, str) else e for e in effects or ()]
        else:
            self.effects = [e for e in effects or () if isinstance(e, Effect)]

    def draw_effect(self, label: str, departure: str | None = None) -> Effect:
        """Draw the effect `label` of unit size, with signs and shape; it is not added."""
        name, *arguments = label.split(":")
        arguments = [number_of(self.robot, part) for part in arguments]
        if name == "target_offset" and arguments and arguments[0] not in self.targets:
            raise ValueError(f"{label!r}: the targets are {sorted(self.targets)}")
        material = Material(
            label, tuple(arguments), self.robot, tuple(self.loads), self.session, self._effect_rng
        )
        return build(material, departure)

    def _nominal_statics(
        self, joints_deg: tuple[float, ...]
    ) -> tuple[list[Matrix], list[Vector], list[float], Vector]:
        """Compute the nominal frames 0..N and the statics of the declared loads.

        The statics are moments, torques and the overturning moment.
        """
        kind = self.robot.convention
        chain = frames(kind, self._nominal_geometry, self.robot.internal(joints_deg))
        joint_moments = moments(kind, chain, self.loads)
        tau = torques(kind, chain, joint_moments)
        return chain, joint_moments, tau, overturning_moment(chain, self.loads)

    def _arm(self, state: ArmState, effects: Sequence[Effect]) -> Arm:
        """Return the arm of one reading with `effects` at work, ready to be evaluated."""
        chain, joint_moments, tau, overturning = self._nominal(tuple(state.joints_deg))
        arm = Arm(
            state=state,
            robot=self.robot,
            angles=self.robot.internal(state.joints_deg),
            previous=self.robot.internal(state.previous_deg),
            extra_angle=[0.0] * len(self.robot.links),
            geometry=self.geometry.copy(),
            loads=list(self.loads),
            nominal_chain=chain,
            t_mean_c=MEAN_C,
            air_c=self.air_c,
            moments=joint_moments,
            torques=tau,
            overturning=overturning,
        )
        for effect in effects:
            if effect.stage == "loads":
                effect.act(arm, effect.values)
        if arm.loads != self.loads:
            arm.moments = moments(self.robot.convention, chain, arm.loads)
            arm.torques = torques(self.robot.convention, chain, arm.moments)
            arm.overturning = overturning_moment(chain, arm.loads)
        for effect in effects:
            if effect.stage == "arm":
                effect.act(arm, effect.values)
        return arm

    def _chain(self, arm: Arm, angle_noise: Vector | None = None) -> list[Matrix]:
        """Compute frames 0..N of the true arm in the world.

        `angle_noise` (N,) rad is the robot's repeatability.
        """
        angles = []
        for i, angle in enumerate(arm.angles):
            deflection = self.compliance[i] * arm.torques[i]
            noise = 0.0 if angle_noise is None else float(angle_noise[i])
            angles.append(angle + deflection + arm.extra_angle[i] + noise)
        chain = frames(self.robot.convention, arm.geometry, angles, arm.lean, arm.tilts)
        return chain if arm.shove is None else [arm.shove @ frame for frame in chain]

    def _target(self, arm: Arm, target: str) -> Vector:
        """Return the true position of `target` in the flange frame, (3,) mm."""
        if target not in self.targets:
            raise ValueError(f"target {target!r} is not one of {sorted(self.targets)}")
        point = np.array(self.targets[target]) + self.misplaced.get(target, 0.0)
        if target in arm.target_shift:
            point = point + arm.target_shift[target]
        return point if arm.tool is None else place(arm.tool, point)

    def _point(
        self,
        state: ArmState,
        target: str,
        effects: Sequence[Effect],
        stages: Sequence[str],
        angle_noise: Vector | None = None,
    ) -> Vector:
        """Compute the target (3,) mm with the effects of the arm and those of the listed stages."""
        arm = self._arm(state, effects)
        flange = self._chain(arm, angle_noise)[-1]
        sight = Sight(state, place(flange, self._target(arm, target)), self.station)
        for stage in stages:
            for effect in effects:
                if effect.stage == stage:
                    effect.act(sight, effect.values)
        return sight.point

    def flange(self, state: ArmState) -> Matrix:
        """Return the true flange in the world frame, (4, 4), lengths mm."""
        return self._chain(self._arm(state, self.effects))[-1]

    def nominal_point(self, state: ArmState, target: str) -> Point:
        """Return the position of `target` in the maker's model, mm.

        It is without base, compliance or any effect.
        """
        chain = self._nominal(tuple(state.joints_deg))[0]
        return as_point(place(chain[-1], self.targets[target]))

    def true_point(self, state: ArmState, target: str) -> Point:
        """Return the true position of `target` in the world frame, mm.

        It is without repeatability and instrument.
        """
        return as_point(self._point(state, target, self.effects, ("point",)))

    def indicated_point(self, state: ArmState, target: str, effects: Sequence[Effect] | None = None) -> Point:
        """Return the point that a tracker without noise would show, mm.

        It is the true point with the instrument's effects. `effects` replaces the world's own list for this call.
        """
        chosen = self.effects if effects is None else effects
        return as_point(self._point(state, target, chosen, ("point", "instrument")))

    def arrival_error(self, reading: int) -> Vector:
        """Return the robot's repeatability in this reading, (N,) rad or mm.

        It is the error of the rest position of the joints.

        A function of seed and reading, so that a point measured twice without moving shows it once.
        """
        rng = np.random.default_rng([self.seed, ARRIVAL_STREAM, reading])
        return self._scatter * rng.normal(size=len(self.robot.links))

    def measured_point(self, state: ArmState, target: str) -> Point:
        """Return the point that the tracker shows, mm.

        It has repeatability, the instrument's effects, and noise. The noise is drawn again in every call; the
        repeatability belongs to `state.reading`.
        """
        arrival = self.arrival_error(state.reading)
        point = self._point(state, target, self.effects, ("point", "instrument"), arrival)
        return as_point(point + self.noise.draw(point, self.station, self._noise_rng))

    def noise_variance(self, state: ArmState, target: str) -> float:
        """Mean variance per axis, mm^2, of one reading: tracker, and repeatability through the arm."""
        arm = self._arm(state, ())
        chain = self._chain(arm)
        point = place(chain[-1], self._target(arm, target))
        total = self.noise.variance_sum(point, self.station)
        for joint, (sigma, slides) in enumerate(zip(self._scatter, self.robot.sliding, strict=True), start=1):
            if slides:
                total += sigma**2
                continue
            frame = axis_frame(self.robot.convention, chain, joint)
            lever = point - frame[:3, 3]
            z = frame[:3, 2]
            # |z x lever|^2: the point's path per rad of this joint
            total += sigma**2 * float(lever @ lever - (z @ lever) ** 2)
        return total / 3.0

    @property
    def truth(self) -> list[dict[str, Any]]:
        """Return label, parameters ({name: {value, unit}}), shape and group of each hidden effect."""
        return [effect.truth() | {"group": group_of(effect.label)} for effect in self.effects]


def as_point(vector: Vector) -> Point:
    """Return a (3,) vector as plain floats."""
    return float(vector[0]), float(vector[1]), float(vector[2])
