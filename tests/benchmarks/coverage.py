"""Coverage of the 95 % intervals that the program reports, over simulated campaigns.

Every campaign draws a robot from the priors, poses and noise, and is measured by the second arm
(`tests.benchmarks.arm`). Two kinds of value count: parameters, by estimate +- 1.96 standard errors, and held-out
positions, by the ellipsoid of `IdentificationFit.predict_with_covariance`. If readings cannot distinguish
parameters, the truth keeps at nominal those that the program drops, since only the combination has a true value.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from calib import Dataset, IdentificationFit, identify, load_robot
from calib.data import Header, Noise
from calib.fit import base_model_of
from calib.units import to_internal
from tests.benchmarks.arm import tool_frames, torques
from tests.benchmarks.clock import line
from tests.calib.campaigns import conditions_of

Array = NDArray[np.float64]

ROBOT = load_robot("abb-irb120")
TARGETS = {"T1": (0.0, 0.0, 125.0), "T2": (75.0, 93.675, 215.0), "T3": (150.0, 0.0, 125.0)}
BASE_TARGETS = {
    "B1": (700.0, -600.0, -150.0),
    "B2": (800.0, 550.0, -100.0),
    "B3": (-400.0, 50.0, 900.0),
    "B4": (150.0, -250.0, -350.0),
}
RANGE = np.radians([[-90, 90], [0, 110], [-80, 70], [-150, 150], [-90, 90], [-180, 180]])
GROUPS = ("base", "geometry", "parallel_twist", "compliance")
_USUAL = {"mm": 5.0, "deg": 0.3}  # base, tool and base targets, which have no prior
POINT_MM, _ROTATION, _LENGTH_MM = 0.05, 1e-4, 0.02


@dataclass(frozen=True)
class Kind:
    """Measurement conditions of a campaign.

    `declared` is the ratio of declared to true noise.
    """

    name: str
    readings: int
    points: bool = True
    poses: bool = False
    groups: tuple[str, ...] = GROUPS
    targets: tuple[str, ...] = ("T1", "T2", "T3")
    base_targets_u_mm: float = 0.0
    declared: float = 1.0
    fresh: int = 20  # poses at which positions are judged, which took no part


KINDS = (
    Kind("points", 60),
    Kind("points, noise declared at 0.7", 60, declared=0.7),
    Kind("poses, tool unknown", 40, poses=True, groups=(*GROUPS, "tool"), targets=("T1",)),
    Kind("distances", 160, points=False),
    Kind("distances, base targets to 0.05 mm", 240, points=False, base_targets_u_mm=0.05),
)


@dataclass(frozen=True)
class Campaign:
    """Simulated campaign: data set, true positions of all rows (n, 3), and truth by parameter."""

    data: Dataset
    positions: Array
    truth: dict[str, float]


def header_of(kind: Kind) -> Header:
    """The header a campaign of this kind would have."""
    rotation, length = _ROTATION * kind.poses, _LENGTH_MM * (not kind.points)
    return Header(
        robot=ROBOT,
        instrument="simulated",
        world="nominal",
        coupling="none",
        gravity=(0.0, 0.0, -9.81),
        groups=kind.groups,
        noise=Noise(
            "isotropic",
            sigma_mm=POINT_MM * kind.declared,
            rotation=rotation * kind.declared,
            length_mm=length * kind.declared,
        ),
        targets={name: TARGETS[name] for name in kind.targets},
        series_targets={},
        loads=ROBOT.loads,
        holdout="as measured",
        base_targets={} if kind.points else BASE_TARGETS,
        base_targets_u_mm=dict.fromkeys(BASE_TARGETS, kind.base_targets_u_mm)
        if kind.base_targets_u_mm
        else {},
    )


def simulate(kind: Kind, seed: int, still: frozenset[str] = frozenset()) -> Campaign:
    """Simulate a campaign with a newly drawn robot, poses and noise.

    The parameters of `still` are at nominal.
    """
    rng = np.random.default_rng(seed)
    n = kind.readings + kind.fresh
    joints = rng.uniform(RANGE[:, 0], RANGE[:, 1], (n, ROBOT.joints))
    names, anchors = tuple(kind.targets), tuple(BASE_TARGETS)
    conditions = replace(
        conditions_of(ROBOT, joints, seed),
        series=np.zeros(n, dtype=np.int64),
        target=rng.integers(0, len(names), n),
        anchor=np.full(n, -1) if kind.points else rng.integers(0, len(anchors), n),
        series_names=("main",),
        target_names=names,
        anchor_names=() if kind.points else anchors,
    )
    nothing = np.full(n, np.nan)
    data = Dataset(
        path=Path("simulated.csv"),
        header=header_of(kind),
        reading_id=tuple(str(i) for i in range(n)),
        sets=np.where(np.arange(n) < kind.readings, "calibration", "validation"),
        status=np.full(n, "ok"),
        conditions=conditions,
        points=np.ones((n, 3)) if kind.points else np.full((n, 3), np.nan),
        orientation=np.eye(4)[np.zeros(n, dtype=int)] if kind.poses else np.full((n, 4), np.nan),
        lengths=nothing if kind.points else np.ones(n),
        u_point=np.full((n, 3), np.nan),
        u_rotation=nothing,
        u_length=nothing,
        sha256="",
    )
    truth = {
        p.name: 0.0
        if p.name in still
        else float(rng.normal(0.0, to_internal(_USUAL[p.unit] if p.size is None else p.size, p.unit)))
        for p in base_model_of(data).parameters
    }
    frames = true_frames(truth, joints, names, conditions.target)
    positions, turns = frames[:, :3, 3], frames[:, :3, :3]
    if kind.points:
        measured = positions + rng.normal(0.0, POINT_MM, (n, 3))
        data = replace(data, points=measured, conditions=replace(conditions, point=measured))
    if kind.poses:
        felt = Rotation.from_rotvec(rng.normal(0.0, _ROTATION, (n, 3))) * Rotation.from_matrix(turns)
        data = replace(data, orientation=felt.as_quat(scalar_first=True))
    if not kind.points:
        ends = np.array(
            [
                [at + truth.get(f"{b}.{k}", 0.0) for at, k in zip(BASE_TARGETS[b], "xyz", strict=True)]
                for b in anchors
            ]
        )[conditions.anchor]
        lengths = np.linalg.norm(positions - ends, axis=1) + rng.normal(0.0, _LENGTH_MM, n)
        data = replace(data, lengths=lengths)
    return Campaign(data, positions, truth)


def true_frames(
    truth: dict[str, float], joints: Array, names: tuple[str, ...], which: NDArray[np.int64]
) -> Array:
    """Compute the frames of the target on the true robot, (n, 4, 4)."""
    torque = torques(ROBOT, joints)
    slots: dict[str, Array | float] = {
        f"theta{k}": truth.get(f"theta{k}", 0.0) + truth.get(f"c{k}", 0.0) * torque[:, k - 1]
        for k in range(1, ROBOT.joints + 1)
    }
    targets = np.array(
        [[at + truth.get(f"{t}.{k}", 0.0) for at, k in zip(TARGETS[t], "xyz", strict=True)] for t in names]
    )
    frames = tool_frames(ROBOT, joints, truth | slots, targets[which])
    turned = [truth.get(f"{names[0]}.r{k}", 0.0) for k in "xyz"]
    frames[:, :3, :3] = frames[:, :3, :3] @ Rotation.from_euler("XYZ", turned).as_matrix()
    return frames


def covered(campaign: Campaign, result: IdentificationFit) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Mask the true parameters (p,) and true positions (f,) within the reported 95 % regions."""
    truth = dict(campaign.truth)
    for target in campaign.data.conditions.target_names:
        if f"{target}.rx" in truth:
            # the program counts these turns from the orientation that it found to start with
            turned = Rotation.from_euler("XYZ", [truth[f"{target}.r{k}"] for k in "xyz"])
            left = Rotation.from_matrix(result.model.turns["main"]).inv() * turned
            truth |= zip([f"{target}.r{k}" for k in "xyz"], left.as_euler("XYZ"), strict=True)
    fitted = result.standard_errors > 0.0
    off = result.estimate - np.array([truth[p.name] for p in result.model.parameters])
    parameters = np.abs(off[fitted]) <= norm.ppf(0.975) * result.standard_errors[fitted]
    rows = campaign.data.validation_rows
    points, covariance = result.predict_with_covariance(campaign.data.conditions.take(rows))
    miss = points - campaign.positions[rows]
    squared = np.sum(miss * np.linalg.solve(covariance, miss[:, :, None])[:, :, 0], axis=1)
    return parameters, squared <= chi2.ppf(0.95, 3)


def study(kind: Kind, count: int) -> tuple[float, float]:
    """Share of parameters and of positions covered, over `count` campaigns."""
    dropped = [drop.name for drop in identify(simulate(kind, 0).data).dropped]
    # base targets of a declared uncertainty have true values, whatever the program makes of them
    still = frozenset(name for name in dropped if name.partition(".")[0] not in BASE_TARGETS)
    parameters, positions = [], []
    for seed in range(1, count + 1):
        campaign = simulate(kind, seed, still)
        inside = covered(campaign, identify(campaign.data))
        parameters.append(inside[0])
        positions.append(inside[1])
    return float(np.concatenate(parameters).mean()), float(np.concatenate(positions).mean())


def run(count: int = 300) -> bool:
    """Print the shares for every kind of reading."""
    reached = True
    for kind in KINDS:
        parameters, positions = study(kind, count)
        for name, share, low, high in (
            ("parameters", parameters, 0.94, 0.96),
            ("positions", positions, 0.93, 0.97),
        ):
            good = low <= share <= high
            line(
                f"95 % covers, {kind.name}: {name}",
                f"{share:.1%}",
                f"{100 * low:.0f}-{100 * high:.0f} %",
                good,
            )
            reached &= good
    return reached
