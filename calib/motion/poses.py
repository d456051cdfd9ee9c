"""Data sets of the poses at which a moving robot was at rest, for `truepose identify`.

The rests are samples slower than a limit, grouped into poses and numbered as waypoints. The data set has
one row per rest, the mean of its samples, or one row per slow sample. The uncertainty u of a row has two
parts:

    u^2 = s^2 / n_e + (u_clock v)^2

Here s is the scatter of the samples' errors about the mean of their rest, of all rests together. The
effective number n_e of samples is smaller than theirs if successive samples are correlated, and v is the
remaining mean velocity. An error of the instrument that is common to all samples of a rest is in neither
part, so no row has less than the instrument's own uncertainty.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from calib.arm.robot import Robot
from calib.array import Array
from calib.convert.table import ConvertedTable
from calib.data.header import DEFAULT_GROUPS
from calib.data.noise import Noise
from calib.errors import DataError
from calib.motion.alignment import Aligned
from calib.motion.solve import SLOW_MM_S
from calib.units import DEG

_LEAST_U_MM = 1e-4
_TURNED = 0.01 * DEG  # a joint that turned less from one rest to the next stays on the side it had
_FEWEST_PAIRS = 20
_CREEP = 0.2 * DEG  # of any joint, within one rest
_SAME_POSE = 0.5 * DEG  # of every joint, of one waypoint


@dataclass(frozen=True)
class Origin:
    """Origin of the streams, for the header of the data set.

    Attributes
    ----------
    robot_name : str
        Robot as a data set names it.
    coupling : str
        Joint matrix of the controller.
    tool : tuple of float
        Tool point, mm.
    simulated : bool
        Whether either stream is from a simulator.
    """

    robot_name: str
    coupling: str
    instrument: str
    tool: tuple[float, float, float]
    tool_known: bool
    remark: str
    simulated: bool = False


def scatter(aligned: Aligned, still: Standstills) -> tuple[Array, float]:
    """Estimate the scatter (3,) of the samples at rest, mm, and their correlation.

    The correlation is that of a sample and the next, 0 to 1. Errors are compared, not points, because
    the robot may creep. If no rest has two samples, the scatter is that of all samples about the aligned
    arm.
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
) -> ConvertedTable:
    """Convert the rests, or all their samples, to columns of a data set and its header.

    Parameters
    ----------
    robot : Robot
        Nominal robot.
    aligned : Aligned
        The aligned streams.
    still : Standstills
        Rests of the robot.
    origin : Origin
        Origin for the header.
    noise : Noise
        Noise of the instrument in the frame of its points; no row has a smaller uncertainty.
    every_sample : bool, optional
        Write one row for every sample instead of one for every rest.
    """
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
    return ConvertedTable(columns, _header(origin))


def _arrivals(joints: Array) -> tuple[Array, Array]:
    """Compute the sides of approach (s, N), +1 or -1, and the joints before (s, N), of rests.

    The rests are in order of time. The arrival at the first one was not seen: it counts as from below,
    as in `calib.data.read`.
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


@dataclass(frozen=True)
class Standstills:
    """k samples at which the robot was at rest.

    Attributes
    ----------
    sample : array of int, shape (k,)
        Index among the aligned samples.
    number : array of int, shape (k,)
        Number of the rest, from 0.
    waypoint : array of int, shape (k,)
        Number of the pose, from 0 in the order of the first visit. Rests within 0.5 deg of each other in
        all joints, directly or through others, are of one waypoint at any time.
    """

    sample: NDArray[np.int64]
    number: NDArray[np.int64]
    waypoint: NDArray[np.int64]

    @property
    def count(self) -> int:
        """Number of rests."""
        return int(self.number[-1]) + 1

    @property
    def waypoints(self) -> int:
        """Number of poses."""
        return int(self.waypoint.max()) + 1


def standstills(aligned: Aligned, slow_mm_s: float = SLOW_MM_S) -> Standstills:
    """Find the samples at which the robot is at rest.

    The tool, according to the robot's own joints, is slower than `slow_mm_s` there. Gross errors are
    excluded. A rest of a robot that creeps is split when a joint has gone 0.2 deg.

    Raises
    ------
    DataError
        The robot is never at rest.
    """
    sample = np.flatnonzero((aligned.speed < slow_mm_s) & (aligned.weight > 0.0))
    if not len(sample):
        raise DataError(
            f"never stands still: its tool is never slower than {slow_mm_s:g} mm/s (slowest "
            f"{aligned.speed.min():.2g} mm/s).",
            do="Let the robot rest for a second at every waypoint, or raise --slower-than.",
            file="robot stream",
        )
    joints = aligned.joints[sample]
    apart = (np.diff(sample) > 1) | (np.max(np.abs(np.diff(joints, axis=0)), axis=1) > _CREEP)
    first = np.maximum.accumulate(np.where(np.append(True, apart), np.arange(len(sample)), 0))
    gone = np.max(np.abs(joints - joints[first]), axis=1) // _CREEP
    number = np.cumsum(np.append(False, apart | (np.diff(gone) != 0.0)))
    return Standstills(sample, number, _waypoints(means(joints, number))[number])


def means(values: Array, group: NDArray[np.int64]) -> Array:
    """Compute the means (g, c) of rows (k, c) by the number of their group (k,)."""
    count = np.bincount(group).astype(np.float64)
    return np.stack([np.bincount(group, column) for column in values.T], axis=1) / count[:, None]


def _waypoints(joints: Array) -> NDArray[np.int64]:
    """Number the pose of every rest with joints (s, N), shape (s,).

    The numbers are in the order of the first visit.
    """
    near = KDTree(joints).query_pairs(_SAME_POSE, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(joints), len(joints)))
    group = connected_components(links, directed=False)[1]
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[number]
