"""Data sets for the tests: simulated campaigns, passed through the files."""

from __future__ import annotations

import copy
import csv
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from calib import Dataset, Robot, load_robot, read_dataset
from calib.arm.kinematics import statics
from calib.array import Array
from calib.data import Conditions
from calib.model import ModelStructure
from mocks.campaign import Campaign, make_campaign

Row = dict[str, Any]


def write_files(folder: Path, rows: Sequence[Row], header: Mapping[str, Any], name: str = "data") -> Path:
    """NAME.csv and NAME.toml in `folder`; numbers keep every digit. Returns the path of the CSV."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(
            {k: repr(float(v)) if isinstance(v, float) else v for k, v in r.items()} for r in rows
        )
    path.with_suffix(".toml").write_text(tomli_w.dumps(dict(header)), encoding="utf-8")
    return path


def dataset_of(campaign: Campaign, folder: Path) -> Dataset:
    """The data set of a campaign, read back from its files."""
    return read_dataset(write_files(folder, campaign.rows, campaign.header))


def simulate(folder: Path, *arguments: Any, **options: Any) -> tuple[Campaign, Dataset]:
    """`make_campaign` and its data set."""
    campaign = make_campaign(*arguments, **options)
    return campaign, dataset_of(campaign, folder)


def exact(campaign: Campaign, sigma_mm: float = 1e-4) -> tuple[list[Row], dict[str, Any]]:
    """Return rows and header of a campaign without noise: every point to the last digit."""
    rows = copy.deepcopy(campaign.rows)
    for row, (state, target) in zip(rows, campaign.readings, strict=True):
        point = campaign.world.indicated_point(state, target)
        row |= dict(zip(("x_mm", "y_mm", "z_mm"), point, strict=True))
    header = copy.deepcopy(campaign.header)
    header["noise"] = {"kind": "isotropic", "sigma_mm": sigma_mm}
    return rows, header


def true_points(campaign: Campaign) -> Array:
    """Compute the readings of an instrument without noise in every row, (n, 3), mm."""
    return np.array([campaign.world.indicated_point(s, t) for s, t in campaign.readings])


def move_rows(rows: list[Row], pose: Array) -> None:
    """Every measured point of `rows` moved by a (4, 4) rigid motion, in place."""
    for row in rows:
        point = pose[:3, :3] @ np.array([row["x_mm"], row["y_mm"], row["z_mm"]]) + pose[:3, 3]
        row |= {axis: float(v) for axis, v in zip(("x_mm", "y_mm", "z_mm"), point, strict=True)}


def conditions_of(robot: Robot, joints: Array, seed: int = 0) -> Conditions:
    """Conditions of readings at model angles (n, N), rad; everything else is drawn from `seed`."""
    rng = np.random.default_rng(seed)
    n, count = joints.shape
    loading = statics(robot, joints)
    return Conditions(
        joints=joints,
        previous=joints + rng.uniform(-0.2, 0.2, (n, count)),
        earlier=np.zeros((n, count)),
        side=rng.choice((-1.0, 1.0), (n, count)),
        torque=loading.torque,
        moment=loading.moment,
        overturning=loading.overturning,
        unit_load=loading.unit_load,
        time=20.0 * (1.0 + np.arange(n)),
        order=np.arange(n, dtype=np.float64),
        temperature=rng.uniform(20.0, 24.0, n),
        point=rng.uniform(-800.0, 800.0, (n, 3)),
        series=rng.integers(0, 2, n),
        target=rng.integers(0, 2, n),
        anchor=rng.integers(0, 2, n),
        waypoint=np.full(n, -1),
        visit=np.arange(n),
        series_names=("day", "night"),
        target_names=("T1", "T2"),
        anchor_names=("B1", "B2"),
    )


def situation(name: str, n: int = 40) -> tuple[ModelStructure, Conditions]:
    """A placed robot of two series, and random conditions."""
    robot = load_robot(name)
    rng = np.random.default_rng(4)
    joints = rng.uniform(np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0), (n, robot.joints))
    targets = {"T1": (0.0, 0.0, 125.0), "T2": (75.0, 93.675, 215.0)}
    turned = np.eye(4)
    turned[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    turned[:3, 3] = [500.0, -200.0, 900.0]
    model = ModelStructure(
        robot,
        (),
        {"day": targets, "night": targets},
        {"day": turned, "night": np.eye(4)},
        (2400.0, -900.0, 350.0),
        anchors={"B1": (900.0, 100.0, 0.0), "B2": (-400.0, 800.0, 50.0)},
    )
    return model, conditions_of(robot, joints)


def with_points(dataset: Dataset, points: Array) -> Dataset:
    """The same data set with other measured points (n, 3)."""
    return replace(dataset, points=points)
