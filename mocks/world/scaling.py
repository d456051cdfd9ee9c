"""Size of an effect: RMS per axis of the displacement it causes, over that of the noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from mocks.world.arm import ArmState
from mocks.world.draw import Session
from mocks.world.effect import Effect
from mocks.world.poses import random_state
from mocks.world.robots import Robot

Reading = tuple[ArmState, str]
"""A state of the arm and the target that is measured in it."""

REHEARSAL_READINGS = 100


class Cell(Protocol):
    """Inputs from a world on which the size of an effect depends."""

    robot: Robot
    seed: int
    session: Session
    targets: dict[str, tuple[float, ...]]
    air_c: Callable[[float], float]

    def indicated_point(
        self, state: ArmState, target: str, effects: Sequence[Effect] | None = None
    ) -> tuple[float, float, float]: ...

    def noise_variance(self, state: ArmState, target: str) -> float: ...


def rehearsal(world: Cell) -> list[Reading]:
    """Random readings spread over the world's session, for a world that knows no campaign yet."""
    rng = np.random.default_rng([world.seed, 99])
    names = list(world.targets)
    n = world.session.readings
    readings = []
    for i in range(REHEARSAL_READINGS):
        order = (i * n) // REHEARSAL_READINGS
        t_s = order * world.session.seconds
        state = random_state(world.robot, world.targets, rng, t_s, world.air_c(t_s), order)
        readings.append((state, names[int(rng.integers(len(names)))]))
    return readings


def displacement(world: Cell, effect: Effect, readings: Sequence[Reading]) -> np.ndarray:
    """Displacement of the noise-free readings by `effect` alone, (n, 3) mm."""
    without = [world.indicated_point(state, target, ()) for state, target in readings]
    with_it = [world.indicated_point(state, target, (effect,)) for state, target in readings]
    return np.array(with_it) - np.array(without)


def rms_per_axis(vectors: np.ndarray) -> float:
    """Return the root mean square over all components of (n, 3) vectors."""
    return math.sqrt(float(np.mean(vectors**2)))


def noise_rms(world: Cell, readings: Sequence[Reading]) -> float:
    """RMS per axis, mm, of the tracker's noise and the robot's repeatability over the readings."""
    return math.sqrt(sum(world.noise_variance(state, target) for state, target in readings) / len(readings))


def scaled(world: Cell, effect: Effect, readings: Sequence[Reading], size: float) -> Effect:
    """`effect` with its amplitudes scaled so that its displacement is `size` times the noise.

    Both are RMS per axis over the readings. Signs and proportions of the amplitudes stay. The displacement
    is not quite linear in the amplitude, so the scale is corrected until it fits to 1e-6.
    ValueError: the effect moves nothing in these readings.
    """
    if size == 0.0:
        return effect.times(0.0)
    without = np.array([world.indicated_point(state, target, ()) for state, target in readings])
    wanted = size * noise_rms(world, readings)
    for _ in range(8):
        with_it = np.array([world.indicated_point(state, target, (effect,)) for state, target in readings])
        found = rms_per_axis(with_it - without)
        if found < 1e-9:
            raise ValueError(f"{effect.label} moves nothing in these readings")
        effect = effect.times(wanted / found)
        if abs(found / wanted - 1.0) < 1e-6:
            break
    return effect
