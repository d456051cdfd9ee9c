"""A true robot whose readings, of any kind, become the files of a data set.

It is the second arm of `tests.benchmarks.arm`, which shares no line with the chain under test.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib import Dataset, read_dataset
from tests.benchmarks.arm import tool_frames, torques
from tests.benchmarks.coverage import BASE_TARGETS, RANGE, ROBOT, TARGETS
from tests.calib.campaigns import Row, write_files

Array = NDArray[np.float64]

POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_rotvec([1.9, -1.1, 0.7]).as_matrix()
POSE[:3, 3] = [1800.0, -2500.0, 400.0]
ALL = ["base", "geometry", "parallel_twist", "compliance"]
NOISE = {"p": 0.03, "o": 1e-4, "l": 0.01}
"""As `Cell.header` declares it: points, mm, orientations, rad, lengths, mm."""


class Cell:
    """Robot with true parameters in the world, whose readings become the rows of a data set."""

    def __init__(self, seed: int = 1, place: Array | None = None) -> None:
        self.rng = np.random.default_rng(seed)
        self.place = np.eye(4) if place is None else place
        names = [f"{kind}{k}" for kind in ("a", "d") for k in range(2, 7) if (kind, k) != ("d", 3)]
        self.add: dict[str, Any] = dict(zip(names, self.rng.normal(0.0, 0.5, len(names)), strict=True))
        turns = [f"{kind}{k}" for kind in ("alpha", "theta") for k in range(2, 7)] + ["beta3"]
        self.add |= zip(turns, np.radians(self.rng.normal(0.0, 0.2, len(turns))), strict=True)
        self.soft = np.array([0.0, 0.1, 0.3, 0.6, 0.5, 0.6]) * 1e-6
        self.targets = {t: np.array(p) for t, p in TARGETS.items()}
        self.base_targets = {b: self.place[:3, :3] @ p + self.place[:3, 3] for b, p in BASE_TARGETS.items()}
        self.turn = Rotation.identity()  # of the tool frame on the flange
        self.zero = 0.0
        self.rows: list[Row] = []
        self.points: list[Array] = []
        self.turns: list[Array] = []

    def measure(
        self,
        what: str,
        n: int,
        targets: Sequence[str] = ("T1", "T2", "T3"),
        series: str = "main",
        noise: Mapping[str, float] | None = None,
        validation: int = 20,
        joints: Array | None = None,
    ) -> None:
        """Add `n` calibration readings and `validation` validation readings.

        `what` contains p for points, o for orientations, l for lengths. `joints` (n + validation, 6) are in rad and
        drawn at random if None. `noise` gives one sigma of points, mm, of orientations, rad, and of lengths, mm,
        under these letters.
        """
        total, noise = n + validation, noise or {}
        joints = self.rng.uniform(RANGE[:, 0], RANGE[:, 1], (total, 6)) if joints is None else joints
        which = self.rng.choice(targets, total)
        slots = {
            f"theta{k}": self.add.get(f"theta{k}", 0.0) + self.soft[k - 1] * torques(ROBOT, joints)[:, k - 1]
            for k in range(1, 7)
        }
        frames = self.place @ tool_frames(
            ROBOT, joints, self.add | slots, np.array([self.targets[t] for t in which])
        )
        points, turns = frames[:, :3, 3], frames[:, :3, :3] @ self.turn.as_matrix()
        felt = Rotation.from_rotvec(
            self.rng.normal(0.0, noise.get("o", 0.0), (total, 3))
        ) * Rotation.from_matrix(turns)
        ends = self.rng.choice(list(self.base_targets), total)
        for i in range(total):
            row: Row = {f"j{k + 1}_deg": float(np.degrees(joints[i, k])) for k in range(6)}
            row |= {"reading_id": f"{series}-{i}", "series": series, "tool_target": str(which[i])}
            row |= {"set": "calibration" if i < n else "validation"}
            row |= dict.fromkeys(
                ("x_mm", "y_mm", "z_mm", "rot_w", "rot_x", "rot_y", "rot_z", "base_target", "length_mm"), ""
            )
            if "p" in what:
                read = points[i] + self.rng.normal(0.0, noise.get("p", 0.0), 3)
                row |= zip(("x_mm", "y_mm", "z_mm"), map(float, read), strict=True)
            if "o" in what:
                row |= zip(
                    ("rot_w", "rot_x", "rot_y", "rot_z"),
                    map(float, felt[i].as_quat(scalar_first=True)),
                    strict=True,
                )
            if "l" in what:
                length = np.linalg.norm(points[i] - self.base_targets[ends[i]]) + self.zero
                row |= {
                    "base_target": str(ends[i]),
                    "length_mm": float(length + self.rng.normal(0.0, noise.get("l", 0.0))),
                }
            self.rows.append(row)
        self.points += list(points)
        self.turns += list(turns)

    def header(self, **more: Any) -> dict[str, Any]:
        """A header of nominal targets; `more` replaces keys."""
        return {
            "format": "truepose-dataset/1",
            "robot": "abb-irb120",
            "world": "free",
            "noise": {"kind": "isotropic", "sigma_mm": 0.03, "rotation_mrad": 0.1, "length_mm": 0.01},
            "tool_targets": {t: list(p) for t, p in TARGETS.items()},
            "base_targets": {b: p.tolist() for b, p in self.base_targets.items()},
        } | more  # fmt: skip

    def dataset(self, folder: Path, **more: Any) -> Dataset:
        """The campaign as the program reads it."""
        return read_dataset(write_files(folder, self.rows, self.header(**more)))
