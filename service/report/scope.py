"""Scope of a report: poses, approach, temperature, load, time and noise of the data."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from acquisition.record import individual_of
from calib.arm import Robot
from calib.array import Array
from calib.data import Dataset
from calib.units import DEG

_APART_MM = 1.0  # a campaign asks about it (`acquisition.run.checks.target_distances`)
_LISTED = 12


def scope_of(dataset: Dataset, rows: NDArray[np.bool_] | None = None) -> list[tuple[str, str]]:
    """Return pairs (property, value) for the rows of a mask, default those of the fit."""
    rows = dataset.fit_rows if rows is None else rows
    conditions = dataset.conditions.take(rows)
    points = dataset.points[rows]
    lines = [
        ("Joint ranges", _ranges(conditions.joints, dataset.header.robot)),
        ("Side of approach", _sides(conditions.side, dataset.header.robot)),
        ("Workspace", _workspace(points[dataset.pointed[rows]])),
        ("Tool targets", ", ".join(conditions.target_names)),
        ("Time", _span(conditions.time, 1.0 / 3600.0, "h") or "not recorded"),
        ("Air temperature", _span(conditions.temperature, 1.0, "°C") or "not recorded"),
        ("Load on the flange", _loads(dataset)),
        ("Absolute accuracy of the controller", dataset.header.absolute_accuracy),
        ("Declared noise (1 sigma)", noise_in_words(dataset)),
    ]
    if dataset.header.unprotected:
        lines.append(("Not protected against damage on the wire", dataset.header.unprotected))
    if off := _apart(dataset):
        more = f" and {len(off) - _LISTED} more" if len(off) > _LISTED else ""
        lines.append(("Targets not as far apart as at first", "; ".join(off[:_LISTED]) + more))
    if len(conditions.series_names) > 1:
        lines.append(("Series", ", ".join(conditions.series_names)))
    return lines


def _apart(dataset: Dataset) -> list[str]:
    """Return pairs of targets whose distance has changed since both were measured first.

    Each pair comes with the later reading.
    """
    conditions, usable = dataset.conditions, dataset.usable & dataset.pointed
    out = []
    for series in np.unique(conditions.series[usable]):
        rows = np.flatnonzero(usable & (conditions.series == series))
        visits, visit = np.unique(conditions.visit[rows], return_inverse=True)
        last = np.full((len(visits), len(conditions.target_names)), -1)
        last[visit, conditions.target[rows]] = rows  # of several readings of one target the last
        for a, b in combinations(range(len(conditions.target_names)), 2):
            both = last[(last[:, a] >= 0) & (last[:, b] >= 0)]
            if not len(both):
                continue
            distance = np.linalg.norm(dataset.points[both[:, a]] - dataset.points[both[:, b]], axis=1)
            off = distance - distance[both.max(axis=1).argmin()]  # as the campaign has asked about it
            pair = f"{conditions.target_names[a]} and {conditions.target_names[b]}"
            out += [
                f"{pair} by {off[k]:+.2f} mm in reading {dataset.reading_id[both[k, [a, b]].max()]}"
                for k in np.flatnonzero(np.abs(off) > _APART_MM)
            ]
    return out


def devices_of(dataset: Dataset) -> list[tuple[str, str]]:
    """Return pairs (role, device) for every robot and instrument that the data set names."""
    several = len(dataset.conditions.series_names) > 1
    return [_device(table, several) for table in dataset.header.devices]


def _device(table: Mapping[str, str], several: bool) -> tuple[str, str]:
    """Return maker, model, serial number and software of a device.

    For a device that was accepted in place of another, it also states by whom and why.
    """
    device = individual_of(table)
    text = str(device)
    if device.firmware:
        text += f", software {device.firmware}"
    if several:
        text += f"; series {table.get('series', '')}"
    if device.reason:
        by = f" by {device.accepted_by}" if device.accepted_by else ""
        text += f"; accepted{by} beside another: {device.reason}"
    return device.role.capitalize(), text


def _workspace(points: Array) -> str:
    if not len(points):
        return "no point was measured: distances only"
    return (
        " × ".join(f"{x:.0f}" for x in np.ptp(points, axis=0))
        + " mm, along x, y, z of the instrument's world"
    )


def noise_in_words(dataset: Dataset) -> str:
    """Return the declared noise of the measured quantities, according to the header.

    That of points is per axis.
    """
    noise = dataset.header.noise
    of_points = {
        "tracker": f"range {noise.range_mm * 1e3:g} µm + {noise.range_ppm:g} ppm, "
        f"across {noise.transverse_mm * 1e3:g} µm + {noise.transverse_ppm:g} ppm",
        "isotropic": f"{noise.sigma_mm * 1e3:g} µm",
        "per-row": "given for every reading",
    }[noise.kind]
    parts = [of_points] if dataset.pointed.any() else []
    if dataset.turned.any():
        parts.append(f"turns {noise.rotation * 1e3:g} mrad")
    if dataset.spanned.any():
        parts.append(f"distances {noise.length_mm * 1e3:g} µm")
    text = "; ".join(parts)
    if noise.repeatability > 0.0:
        text += f"; robot repeatability {noise.repeatability / DEG * 1e3:g} mdeg a joint"
    if noise.repeatability_mm > 0.0:
        text += f"; {noise.repeatability_mm * 1e3:g} µm a slide"
    return text


def _ranges(joints: Array, robot: Robot) -> str:
    low, high = joints.min(axis=0) / robot.joint_units, joints.max(axis=0) / robot.joint_units
    signs = [" mm" if unit == "mm" else "°" for unit in robot.units]
    each = zip(robot.axes, low, high, signs, strict=True)
    return "; ".join(f"{axis.upper()} {a:.0f} to {b:.0f}{sign}" for axis, a, b, sign in each)


def _sides(side: Array, robot: Robot) -> str:
    below = np.mean(side > 0.0, axis=0)
    if np.all((below > 0.0) & (below < 1.0)):
        return "both sides on every joint"
    names = {1.0: "from below", 0.0: "from above"}
    each = zip(robot.axes, below, strict=True)
    return "; ".join(f"{axis.upper()} {names.get(float(share), 'both sides')}" for axis, share in each)


def _span(values: Array, factor: float, unit: str) -> str:
    known = values[np.isfinite(values)] * factor
    return f"{known.min():.1f} to {known.max():.1f} {unit}" if len(known) else ""


def _loads(dataset: Dataset) -> str:
    last = dataset.header.robot.joints
    on_flange = [load for load in dataset.header.loads if load.link == last]
    if not on_flange:
        return "none declared"
    return "; ".join(
        f"{load.mass_kg:g} kg, centre of gravity ({', '.join(f'{x:g}' for x in load.cog_mm)}) mm"
        for load in on_flange
    )
