"""The readings as data sets of ours, by way of their files."""

from __future__ import annotations

import csv
import tempfile
from pathlib import Path

import numpy as np
import tomli_w

from calib import Dataset, read_dataset
from tests.benchmarks.peers.arm import SIGMA_MM, TARGET_MM, Array

GROUPS = ("base", "geometry", "parallel_twist", "tool")


def dataset_of(joints: Array, points: Array) -> Dataset:
    """Calibration readings at joint angles (n, 6), rad, of points (n, 3), mm."""
    header = {
        "format": "truepose-dataset/1",
        "robot": "abb-irb120",
        "noise": {"kind": "isotropic", "sigma_mm": SIGMA_MM},
        "tool_targets": {"T1": list(TARGET_MM)},
        "model": {"fit": list(GROUPS)},
    }
    names = [*(f"j{k}_deg" for k in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    rows = np.column_stack([np.degrees(joints), points]).tolist()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.csv"
        with path.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([names, *rows])
        path.with_suffix(".toml").write_text(tomli_w.dumps(header), encoding="utf-8")
        return read_dataset(path)
