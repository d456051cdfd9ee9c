"""Simulated set-up of Khanesar et al. 2022: a UR5, 38 waypoints and 209 tracker samples.

The tool points down and carries one reflector on the axis of joint 6; the samples are near-static. The arm is the
second one of `tests.calib.chain`.

Every joint stops with an error that is drawn once per waypoint: 38 errors, not 209. Their size and that of the
arm's errors are tuned to the floor and to the uncalibrated result of the paper's Table 3.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from calib import Dataset, load_robot, read_dataset
from tests.calib.campaigns import Row, write_files
from tests.calib.chain import chain

Array = NDArray[np.float64]

ROBOT = load_robot("ur5")
REFLECTOR = (0.0, 0.0, 169.5)
WAYPOINTS, SAMPLES = 38, 209
# Errors, rad, of every joint at every waypoint: MLS-SVR then leaves 20.9 um in sample, as in the paper
STOPS_BESIDE = 3.4e-5
# Mean absolute error of the nominal robot in its place: the paper's, by the arm's numbers
UNCALIBRATED_MM = 0.0719
TRACKER_MM = 0.008
WORLD = np.eye(4)
WORLD[:3, :3] = Rotation.from_euler("xyz", (0.02, -0.01, 2.0)).as_matrix()
WORLD[:3, 3] = (2500.0, 300.0, -800.0)


def waypoints(rng: np.random.Generator, count: int = WAYPOINTS) -> Array:
    """Draw joint angles (count, 6), rad, with the tool pointing down."""
    q = np.empty((count, 6))
    q[:, 0] = rng.uniform(-1.0, 1.0, count)
    q[:, 1] = rng.uniform(-1.9, -1.1, count)
    q[:, 2] = rng.uniform(1.2, 2.0, count)
    q[:, 3] = -np.pi / 2.0 - q[:, 1] - q[:, 2]
    q[:, 4] = -np.pi / 2.0
    q[:, 5] = rng.uniform(-0.5, 0.5, count)
    return q


def rows_of(
    seed: int, *, count: int = WAYPOINTS, samples: int = SAMPLES, waves: float = 0.0
) -> tuple[list[Row], dict[str, Any]]:
    """Simulate rows and header of a data set.

    `waves`, rad, is a once-per-turn error of every joint's gear, which no level frees.
    """
    rng = np.random.default_rng(seed)
    off = {f"{k}{i}": 1e-4 * rng.normal() for k in ("alpha", "theta") for i in range(1, 7)}
    off |= {f"{k}{i}": 0.1 * rng.normal() for k in ("a", "d") for i in range(1, 7)}
    off |= {"beta2": 1e-4 * rng.normal(), "beta3": 1e-4 * rng.normal()}
    phase = rng.uniform(0.0, 2.0 * np.pi, 6)
    at = waypoints(rng, count)
    which = np.sort(np.arange(samples) % count)
    stops = STOPS_BESIDE * rng.normal(size=at.shape)
    off = _tuned(off, at, at + stops, np.bincount(which, minlength=count))
    beside = stops[which]
    # The slowest samples still creep: a few tenths of a millimetre along the path.
    joints = at[which] + rng.normal(size=(samples, 1)) * 1e-4 * (np.roll(at, -1, axis=0) - at)[which]
    real = joints + beside + waves * np.sin(joints + phase)
    arm = _points(real, off)
    points = arm @ WORLD[:3, :3].T + WORLD[:3, 3] + TRACKER_MM * rng.normal(size=arm.shape)
    rows: list[Row] = []
    for i, (q, point) in enumerate(zip(np.degrees(joints), points, strict=True)):
        row: Row = {"reading_id": str(i + 1), "t_s": float(i), "tool_target": "T1"}
        row |= {f"j{k}_deg": float(angle) for k, angle in enumerate(q, start=1)}
        row |= dict(zip(("x_mm", "y_mm", "z_mm"), map(float, point), strict=True))
        rows.append(row)
    header = {
        "format": "truepose-dataset/1",
        "robot": "ur5",
        "instrument": "leica-at960",
        "world": "free",
        "noise": {"kind": "isotropic", "sigma_mm": 0.03},
        "tool_targets": {"T1": list(REFLECTOR)},
    }
    return rows, header


def _tuned(off: dict[str, float], asked: Array, real: Array, samples: NDArray[np.int64]) -> dict[str, float]:
    """Scale the errors of the arm to the paper's uncalibrated result of the nominal robot.

    That result is for one of the world's axes. `asked` and `real` are joints (n, 6), rad; `samples` (n,) counts the
    samples of each waypoint.
    """
    nominal = _points(asked, {})

    def missed(scale: float) -> float:
        there = _points(real, {name: scale * size for name, size in off.items()})
        goal, own = (each - np.average(each, axis=0, weights=samples) for each in (there, nominal))
        turn = Rotation.align_vectors(goal, own, weights=samples)[0]
        left = (goal - turn.apply(own)) @ WORLD[:3, :3].T
        return float(np.average(np.abs(left), axis=0, weights=samples).mean())

    scale = cast(float, brentq(lambda scale: missed(scale) - UNCALIBRATED_MM, 0.0, 100.0, xtol=1e-6))
    return {name: scale * size for name, size in off.items()}


def _points(joints: Array, off: dict[str, float]) -> Array:
    """Compute the positions of the reflector in the base frame, (n, 3), mm."""
    return np.array([chain(ROBOT, q, off, REFLECTOR).real[:3, 3] for q in joints])


def simulate(folder: Path, seed: int, **options: Any) -> Dataset:
    """The data set of `rows_of`, through its files."""
    rows, header = rows_of(seed, **options)
    return read_dataset(write_files(folder, rows, header))
