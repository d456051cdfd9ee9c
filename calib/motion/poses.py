"""A data set of the poses at which a moving robot was at rest, for `truepose identify`.

One row a standstill, the mean of its samples, or every slow sample. The uncertainty of a row has two parts:

    u^2 = s^2 / n_e + (u_clock v)^2

s the scatter of the samples' errors about the mean of their standstill, of all standstills together; n_e the number of
samples, less where they hang together from one to the next; v the mean velocity left. What the instrument errs by in
all samples of a standstill is in neither, so no row has less than the instrument's own uncertainty.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arm.robot import Robot
from calib.array import Array
from calib.convert.table import Table
from calib.data.groups import DEFAULT_GROUPS
from calib.data.noise import Noise
from calib.motion.alignment import Aligned
from calib.motion.still import Standstills, means
from calib.units import DEG

_LEAST_U_MM = 1e-4
_TURNED = 0.01 * DEG  # a joint that turned less from one standstill to the next rests on the side it had
_FEWEST_PAIRS = 20


@dataclass(frozen=True)
class Origin:
    """The origin for the header: the robot as a data set names it, its coupling, the tool point, mm, and whether
    either stream is of a simulator."""

    robot_name: str
    coupling: str
    instrument: str
    tool: tuple[float, float, float]
    tool_known: bool
    remark: str
    simulated: bool = False


def scatter(aligned: Aligned, still: Standstills) -> tuple[Array, float]:
    """(3,) scatter of the samples of a standstill, mm, and how alike a sample and the next are, 0 to 1.

    Errors are compared, not points: the robot may creep. Where no standstill has two samples, the scatter is that of
    all samples about the aligned arm.
    """
    error = aligned.error[still.sample]
    left = error - means(error, still.number)[still.number]
    freedom = len(left) - still.count
    if freedom < 1:
        believed = aligned.error[aligned.weight > 0.0]
        return np.maximum(1.4826 * np.median(np.abs(believed), axis=0), _LEAST_U_MM), 0.0
    s = np.sqrt(np.sum(left**2, axis=0) / freedom)
    pairs = np.flatnonzero(np.diff(still.number) == 0)
    if len(pairs) < _FEWEST_PAIRS:
        return np.maximum(s, _LEAST_U_MM), 0.0
    # The mean of n samples was taken off: what is left of independent ones has the correlation -1/n.
    share = len(left) / freedom
    alike = share * float(np.sum(left[pairs] * left[pairs + 1]) / max(np.sum(left[pairs] ** 2), 1e-300))
    expected = -still.count / len(left) * share
    return np.maximum(s, _LEAST_U_MM), float(np.clip(alike - expected, 0.0, 0.95))


def data_set(
    robot: Robot,
    aligned: Aligned,
    still: Standstills,
    origin: Origin,
    noise: Noise,
    *,
    every_sample: bool = False,
) -> Table:
    """The standstills, or all their samples, as columns of a data set and its header. noise: of the instrument, in the
    frame of its points: no row has a smaller uncertainty."""
    own, alike = scatter(aligned, still)
    joints = robot.controller_angles(aligned.joints[still.sample], origin.coupling) / DEG
    of_standstill = means(joints, still.number)
    group = np.arange(len(still.sample)) if every_sample else still.number
    first = np.unique(group, return_index=True)[1]
    samples = np.bincount(group)
    effective = np.maximum(samples * (1.0 - alike) / (1.0 + alike), 1.0)
    velocity = means(aligned.velocity[still.sample], group)
    points = means(aligned.point[still.sample], group)
    least = noise.of_points(points, np.full_like(points, np.nan))
    u = np.sqrt(own**2 / effective[:, None] + (aligned.u_offset * velocity) ** 2)
    u = np.maximum(u, np.sqrt(np.diagonal(least, axis1=1, axis2=2)))
    time = aligned.time[still.sample]
    columns: dict[str, list[str]] = {
        "reading_id": [str(i + 1) for i in range(len(first))],
        "t_s": _text(means(time[:, None], group)[:, 0], 4),
    }
    number, waypoint = still.number[first], still.waypoint[first]
    side, previous = _arrivals(of_standstill)
    shown = joints if every_sample else of_standstill
    for k in range(robot.joints):
        columns[f"j{k + 1}_deg"] = _text(shown[:, k], 6)
    columns["tool_target"] = ["T1"] * len(first)
    for name, values in (("{}_mm", points), ("u_{}_mm", u)):
        for k, axis in enumerate("xyz"):
            columns[name.format(axis)] = _text(values[:, k], 6)
    columns["waypoint"] = [str(i) for i in waypoint]
    columns["samples"] = [str(n) for n in samples]
    for k in range(robot.joints):
        columns[f"approach{k + 1}"] = [f"{value:.0f}" for value in side[number, k]]
        columns[f"prev{k + 1}_deg"] = _text(previous[number, k], 6)
    return Table(columns, _header(origin))


def _arrivals(joints: Array) -> tuple[Array, Array]:
    """Side of approach (s, N), +1 or -1, and joints before (s, N), of standstills in time.

    How the robot came to the first one was not seen: from below, as `calib.data.arrivals` has it where nobody knows.
    """
    previous = np.concatenate([joints[:1], joints[:-1]])
    moved = np.where(np.abs(joints - previous) > _TURNED / DEG, np.sign(joints - previous), 0.0)
    last = np.maximum.accumulate(np.where(moved != 0.0, np.arange(len(joints))[:, None], 0), axis=0)
    side = np.take_along_axis(moved, last, axis=0)
    return np.where(side == 0.0, 1.0, side), previous


def _text(values: Sequence[float] | Array, decimals: int) -> list[str]:
    return [f"{value:.{decimals}f}" for value in values]


def _header(origin: Origin) -> str:
    groups = [*DEFAULT_GROUPS, *(() if origin.tool_known else ("tool",))]
    return f"""# {origin.remark}
format = "truepose-dataset/1"
robot = {json.dumps(origin.robot_name, ensure_ascii=False)}
instrument = {json.dumps(origin.instrument, ensure_ascii=False)}
world = "free"
joint_coupling = {json.dumps(origin.coupling)}
{"simulated = true" if origin.simulated else ""}

[model]
fit = {json.dumps(groups)}

[noise]
kind = "per-row"

[tool_targets]
T1 = {json.dumps(list(origin.tool))}
"""
