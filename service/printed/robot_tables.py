"""Tables and documents of a robot file: links, postures and properties of the arm."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from rich.table import Table

from calib.arm import Robot
from calib.robot_file import Described, RobotFileVerdict, in_words
from calib.units import DEG


def link_table(robot: Robot) -> Table:
    """Show one row per link: DH numbers in deg and mm, and the limits of the joint."""
    table = Table(box=None, pad_edge=False)
    for head in ("link", "joint", "alpha deg", "a mm", "theta deg", "d mm", "lowest", "highest", ""):
        table.add_column(head, justify="left" if head in ("joint", "") else "right")
    for k, unit in enumerate(robot.joint_units):
        numbers = (robot.alpha[k] / DEG, robot.a[k], robot.theta[k] / DEG, robot.d[k])
        limits = (robot.lower[k] / unit, robot.upper[k] / unit)
        shown = [_number(x) for x in (*numbers, *limits)]
        table.add_row(str(k + 1), f"{robot.axes[k]} {robot.kinds[k]}", *shown, robot.units[k])
    return table


def posture_table(robot: Robot, found: Described) -> Table:
    """Show one row per named posture: joints and pose of the flange."""
    table = Table(box=None, pad_edge=False)
    for head in ("posture", "joints", "flange in the base frame"):
        table.add_column(head, overflow="fold")
    for name, (joints, pose) in found.postures.items():
        counted = zip(joints / robot.joint_units, robot.units, strict=True)
        shown = ", ".join(f"{x:g} {unit}" for x, unit in counted)
        table.add_row(name, shown, in_words(pose))
    return table


def described_lines(found: Described) -> Iterator[str]:
    """Yield reach, wrist, inverse kinematics and remarks, one line each."""
    yield f"Reach of the flange from axis 1: {found.reach_mm:.0f} mm. All links in a line: {found.span_mm:.0f} mm."
    yield f"Wrist: {found.wrist}."
    yield f"Inverse kinematics: {found.inverse}."
    yield from (f"Look: {remark}" for remark in found.remarks)


def verdict_lines(verdict: RobotFileVerdict) -> Iterator[str]:
    """Yield the lines of the verdict of some check readings on a robot file."""
    tool = " (the tool comes out of them)" if verdict.tool_unknown else ""
    yield (
        f"{verdict.readings} readings{tool}: the nominal robot misses a quarter of them by more than "
        f"{verdict.miss_mm:.3g} mm over {verdict.extent_mm:.0f} mm."
    )
    if verdict.explained:
        yield "The file explains the readings: no usual mistake is in it."
    elif not verdict.mistakes:
        yield "No usual mistake alone explains them: hold table, zeros and directions against the data sheet."
    said: dict[str, list[str]] = {}
    for mistake in verdict.mistakes:
        said.setdefault(mistake.what, []).extend(mistake.lines)
    for number, (what, lines) in enumerate(said.items()):
        which = f"Mistake, {verdict.left_mm:.3g} mm when mended" if not number else "As likely"
        yield f"{which}: {what}."
        yield from (f"    {line}" for line in dict.fromkeys(lines))


def verdict_document(verdict: RobotFileVerdict) -> dict[str, Any]:
    """Return the verdict on a robot file as a document, lengths in mm."""
    return {
        "count": verdict.readings,
        "miss_mm": verdict.miss_mm,
        "left_mm": verdict.left_mm,
        "extent_mm": verdict.extent_mm,
        "explained": verdict.explained,
        "mistakes": [{"what": each.what, "lines": list(each.lines)} for each in verdict.mistakes],
    }


def document_of(robot: Robot, found: Described | None = None) -> dict[str, Any]:
    """Return a robot as a document: lengths in mm, angles in deg, joints in deg or mm by kind."""
    out: dict[str, Any] = {
        "name": robot.name,
        "maker": robot.maker,
        "convention": robot.convention,
        "joints": robot.joints,
        "links": [
            {
                "alpha_deg": robot.alpha[k] / DEG,
                "a_mm": robot.a[k],
                "theta_deg": robot.theta[k] / DEG,
                "d_mm": robot.d[k],
                f"min_{robot.units[k]}": robot.lower[k] / robot.joint_units[k],
                f"max_{robot.units[k]}": robot.upper[k] / robot.joint_units[k],
            }
            for k in range(robot.joints)
        ],
        "joint_matrices": sorted(robot.joint_matrices),
        "source": robot.source,
    }
    if found is None:
        return out
    return out | {
        "reach_mm": found.reach_mm,
        "wrist": found.wrist,
        "inverse_kinematics": found.inverse,
        "remarks": list(found.remarks),
        "postures": [
            {
                "name": name,
                "joints": (joints / robot.joint_units).tolist(),
                "flange_mm": pose[:3, 3].tolist(),
                "rotation": pose[:3, :3].tolist(),
            }
            for name, (joints, pose) in found.postures.items()
        ],
    }


def _number(value: float) -> str:
    return f"{np.round(value, 6) + 0.0:g}"
