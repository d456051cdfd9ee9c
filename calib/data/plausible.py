"""Plausibility of data files: misread files, repeated readings and mixed series.

With a left-handed frame, a wrong unit or a joint of the wrong sign the readings stay consistent among
themselves, and the least-squares fit misses them by decimetres. Each such error is tried in turn
(`calib.data.hypotheses`). If the nominal robot then fits clearly better, the readings are refused and
the error is named. `remarks` reports conditions that are no error but limit the information of the
readings.

One series may mix readings: some from another station, or of another target of the tool. The nominal
robot is placed where it agrees with most readings. The other readings are of a second kind if they agree
with each other: with another place of the base, or with another point on the flange.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arm.start import align, tool_turn
from calib.array import Array
from calib.data.conditions import row_keys
from calib.data.dataset import Dataset
from calib.data.header import Header
from calib.data.hypotheses import (
    BETTER,
    FEWEST,
    Hypothesis,
    InterpretedReadings,
    both,
    explained,
    extent_of,
    of_points,
    of_robot,
    of_rows,
    of_tools,
    slipped,
)
from calib.data.joints_misread import of_directions, of_joints
from calib.errors import DataError

# Miss of the nominal robot, as a share of the extent of the readings (or rad), that explains itself
_GOOD = 0.05
_BETTER = 0.1  # share of the miss that may be left when it is explained
_NARROW = 20.0  # deg or mm
_STUCK_ROWS = 3  # that give one point to the last digit
READ_APART = 0.01
"""deg or mm by which joints are read back elsewhere than commanded before it is reported."""

_MIRROR = np.array([-1.0, 1.0, 1.0])
_ENOUGH = 300  # readings of a series that show what the files mean
_MOST_RIVALS = 2
_MOST_NAMED = 8
_TRIES = 400  # triples of readings that may place the robot: of 60 % that belong together, one in five does
_NEAR = 0.02  # share of the extent by which a nominal robot may miss a reading
_MOST = 0.95  # share of the readings that one kind may have before there are two
_LEAST = 0.4  # share that must agree for the rest to be called another kind
_STATION, _TARGET = 6, 3  # readings that may show another station, another target
_ROUNDS = 3


def refuse_implausible(dataset: Dataset) -> None:
    """Raise DataError if the files can only have another meaning; the error states it.

    Examples are points that are mirrored or in another unit, joints with another sign, order or zero,
    and rows that slipped. Others are another robot, another reading of its file
    (`calib.data.hypotheses`), and quaternions in another order.
    """
    _refuse_stuck(dataset)
    conditions = dataset.conditions
    controller = dataset.header.robot.controller_angles(conditions.joints, dataset.header.coupling)
    for s, series in enumerate(conditions.series_names):
        rows = dataset.fit_rows & (conditions.series == s)
        tools = _tools(dataset, series)
        for measured in (rows & dataset.pointed, rows & dataset.spanned & ~dataset.pointed):
            if measured.sum() >= FEWEST:
                _refuse_misread(dataset, series, controller, tools, measured)
        turned = rows & dataset.turned
        if turned.sum() >= FEWEST:
            flange = forward(dataset.header.robot, conditions.joints[turned])
            arm = np.einsum("nij,nj->ni", flange[:, :3, :3], tools[conditions.target[turned]])
            _refuse_turns(dataset, series, flange, flange[:, :3, 3] + arm, turned)


def _refuse_stuck(dataset: Dataset) -> None:
    """Raise DataError for one point in many postures, if most readings have separate points.

    An instrument that sees nothing may show such a point. A ball in sockets has few points in any case.
    """
    rows = np.flatnonzero(dataset.usable & dataset.pointed)
    found, which, count = np.unique(dataset.points[rows], axis=0, return_inverse=True, return_counts=True)
    stuck = count >= _STUCK_ROWS
    for k in np.flatnonzero(stuck & (count[stuck].sum() < 0.5 * len(rows))):
        same = rows[which.reshape(-1) == k]
        flange = forward(dataset.header.robot, dataset.conditions.joints[same])[:, :3, 3]
        if np.max(np.ptp(flange, axis=0)) > _NARROW:
            names = ", ".join(dataset.reading_id[i] for i in same[:_MOST_NAMED])
            more = ", ..." if len(same) > _MOST_NAMED else ""
            x, y, z = found[k].tolist()
            raise DataError(
                f"are {x:g}, {y:g}, {z:g} in {len(same)} readings ({names}{more}) of different postures, as from an "
                "instrument that sees nothing.",
                do="Leave these cells empty.",
                file=dataset.path,
                key="x_mm, y_mm, z_mm",
            )


def _tools(dataset: Dataset, series: str) -> Array:
    """Return the nominal tool targets of a series, shape (T, 3), mm.

    They are in the order of the data set's names.
    """
    known = dataset.header.targets_of(series)
    return np.array([known.get(name, (0.0, 0.0, 0.0)) for name in dataset.conditions.target_names])


def _refuse_misread(
    dataset: Dataset, series: str, controller: Array, tools: Array, measured: NDArray[np.bool_]
) -> None:
    header, conditions = dataset.header, dataset.conditions
    pointed = bool(dataset.pointed[measured].any())
    everything = InterpretedReadings(
        header.robot,
        header.coupling,
        controller,
        conditions.target,
        dataset.points if pointed else None,
        None if pointed else dataset.lengths,
        None if pointed else conditions.anchor,
    )
    rows = np.flatnonzero(measured)
    if pointed:  # of distances, the legs of one pose are no repeats of each other
        rows = _beside_moves(rows, conditions.pose)
    rows = rows[:: max(1, -(-len(rows) // _ENOUGH))]
    meaning = replace(
        everything,
        angles=controller[rows],
        which=conditions.target[rows],
        points=dataset.points[rows] if pointed else None,
        lengths=None if pointed else dataset.lengths[rows],
        anchor=None if pointed else conditions.anchor[rows],
    )
    unknown = {"tool_unknown": "tool" in header.groups, "zero_unknown": header.frees_length_zero}
    why = explained(
        meaning,
        lambda: chain(
            of_points(meaning),
            of_joints(meaning),
            of_directions(meaning),
            # tool targets that are fitted are only where the fit begins
            () if "tool" in header.groups else of_tools(meaning, conditions.target_names),
            of_robot(meaning),
            of_rows(everything, rows, measured),
        ),
        tools,
        **unknown,
    ) or explained(
        meaning, lambda: _pairs(meaning, everything, rows, measured), tools, tool_as_given=True, **unknown
    )
    if why is None and pointed:
        why = slipped(meaning, of_rows(everything, rows, measured), tools)
    if why is None:
        if pointed and "tool" not in header.groups:
            _refuse_mixed(dataset, series, meaning, tools, rows)
        return
    others = (*why.equals, *why.rivals[: max(_MOST_RIVALS - len(why.equals), 0)])
    said = dict.fromkeys(f" As likely: {other.what}. {other.do}" for other in others)
    said.pop(f" As likely: {why.cause.what}. {why.cause.do}", None)
    rivals = "".join(said)
    raise DataError(
        f"{why.cause.what}. The nominal robot misses a quarter of the readings of series '{series}' by more than "
        f"{why.miss:.3g} mm; read in that way, by more than {why.left:.3g} mm.",
        do=why.cause.do + rivals,
        file=dataset.path if why.cause.file == "data" else dataset.path.with_suffix(".toml"),
        key=why.cause.key,
    )


def _beside_moves(rows: NDArray[np.int64], pose: NDArray[np.int64]) -> NDArray[np.int64]:
    """Select the first and the last row of each stay at a pose.

    The others repeat them, and hide rows that slipped.
    """
    moved = np.diff(pose[rows]) != 0
    beside = np.append(False, moved) | np.append(moved, False)
    return rows[beside] if beside.sum() >= FEWEST else rows


def _pairs(
    meaning: InterpretedReadings,
    everything: InterpretedReadings,
    rows: NDArray[np.int64],
    measured: NDArray[np.bool_],
) -> Iterator[Hypothesis]:
    """Two mistakes at once: of the points and of rows or joints, or of the joints alone."""
    for one in of_points(everything):
        yield from (both(one, other) for other in of_rows(one.meaning, rows, measured))
    for one in of_points(meaning):
        yield from (both(one, other) for other in chain(of_joints(one.meaning), of_directions(one.meaning)))
    for i, one in enumerate(of_joints(meaning)):
        yield from (both(one, other) for other in islice(of_joints(one.meaning), i))


def _refuse_mixed(
    dataset: Dataset, series: str, meaning: InterpretedReadings, tools: Array, rows: NDArray[np.int64]
) -> None:
    apart = mixture(meaning, tools)
    if apart is None:
        return
    names = [dataset.reading_id[i] for i in rows[apart.rows]]
    listed = ", ".join(names[:_MOST_NAMED]) + (", ..." if len(names) > _MOST_NAMED else "")
    some = f"{len(names)} of {len(rows)} readings of series '{series}' that were looked at ({listed})"
    if apart.offset is None:
        raise DataError(
            f"{some} were measured from another station, or with the robot elsewhere. The nominal robot fits "
            "these readings and the others only with a separate base position for each group. With the base position "
            f"of the others it misses these readings by {apart.miss:.3g} mm.",
            do="Give the readings of each station a separate name in the column series.",
            file=dataset.path,
            key="series",
        )
    x, y, z = (0.0 + round(value, 1) for value in apart.offset.tolist())
    raise DataError(
        f"{some} belong to another tool target: at [{x:g}, {y:g}, {z:g}] mm from the named one, in the "
        "flange frame.",
        do="Name their target in the column tool_target, with its place under [tool_targets].",
        file=dataset.path,
        key="tool_target",
    )


def _refuse_turns(
    dataset: Dataset, series: str, flange: Array, nominal: Array, rows: NDArray[np.bool_]
) -> None:
    base = np.eye(4)
    base[:3, :3], _ = align(nominal, dataset.points[rows], np.ones(len(nominal)))
    orientation = dataset.orientation[rows]

    def left(read: Array) -> float:
        """Median turn, rad, that remains behind a constant turn of the tool."""
        turn = base[:3, :3] @ flange[:, :3, :3] @ tool_turn(flange, base, read)
        off = Rotation.from_matrix(turn).inv() * Rotation.from_quat(read, scalar_first=True)
        return float(np.median(off.magnitude()))

    if (plain := left(orientation)) < _GOOD:
        return
    readings = {
        "hold the scalar last": orientation[:, [3, 0, 1, 2]],
        "turn in the other direction, from the tool to the world": orientation * (1.0, -1.0, -1.0, -1.0),
    }
    for what, read in readings.items():
        if left(read) < min(_BETTER * plain, _GOOD):
            raise DataError(
                f"the quaternions of series '{series}' {what}: read so, they fit the robot.",
                do="Write the orientation of the tool frame in the world, rot_w the scalar.",
                file=dataset.path,
                key="rot_w..rot_z",
            )


def refuse_mirrored(dataset: Dataset, here: Mapping[str, Array], declared: Mapping[str, Array]) -> None:
    """Raise DataError if declared base targets are mirrored to those located by distances.

    `declared` are positions in the world, `here` those located, both in mm. At least four are needed
    that do not lie in a plane.
    """
    if len(here) < 4:
        return
    found, goal = np.array(list(here.values())), np.array([declared[name] for name in here])

    def left(places: Array) -> float:
        rotation, translation = align(found, places, np.ones(len(found)))
        return float(np.linalg.norm(places - found @ rotation.T - translation, axis=1).max())

    plain = left(goal)
    if plain > _GOOD * np.linalg.norm(np.std(goal, axis=0)) and left(goal * _MIRROR) < _BETTER * plain:
        raise DataError(
            "are mirrored compared with the positions found from the lengths: their frame is left-handed.",
            do="Change the sign of one axis for all of them.",
            file=dataset.path.with_suffix(".toml"),
            key="base_targets",
        )


def assumed_in_words(header: Header) -> str:
    """Return a sentence on targets whose uncertainty was not stated; '' if there are none."""
    u_mm = {**header.tool_targets_u_mm, **header.base_targets_u_mm}
    assumed = [f"{name} ({u_mm.get(name, 0.0):g} mm)" for name in header.u_mm_assumed]
    if not assumed:
        return ""
    return (
        f"Nobody stated how well these are known: {', '.join(assumed)}, assumed. State u_mm under [world] and [tool] "
        "in the cell file."
    )


def turned_apart(apart: Array, units: Sequence[str]) -> Array:
    """Wrap differences of joints (n, N), rad or mm, to half a turn for joints that turn."""
    turns = np.array([unit != "mm" for unit in units])
    return np.where(turns, (apart + np.pi) % (2.0 * np.pi) - np.pi, apart)


def read_apart_in_words(apart: Array, robot: Robot) -> str:
    """Return a sentence on joints read back elsewhere than commanded; '' if there are none.

    `apart` (n, N) are the differences, rad or mm, NaN if nothing was read.
    """
    shown = np.abs(apart) / robot.joint_units
    largest = np.nanmax(shown, axis=0, initial=0.0)
    far = np.flatnonzero(largest > READ_APART)
    if not len(far):
        return ""
    joints = ", ".join(
        f"{robot.axes[k].removeprefix('j')} by up to {largest[k]:.3f} {robot.units[k]}"
        f" (median {np.nanmedian(shown[:, k]):.3f})"
        for k in far
    )
    return (
        f"The controller read joints back elsewhere than commanded: joint {joints}. The commanded ones are used, so "
        "an error found of such a joint, as its play, may be that the robot did not stand where it was sent."
    )


def remarks(dataset: Dataset) -> list[str]:
    """List limitations of the readings of a fit.

    They include repeated rows, narrow joints and one-sided approaches; each is a sentence.
    """
    rows = dataset.fit_rows
    out = []
    if dataset.read_apart is not None and (
        words := read_apart_in_words(dataset.read_apart[rows], dataset.header.robot)
    ):
        out.append(words)
    if dataset.header.read_back:
        out.append(
            "The joints are those that the controller read back, not those commanded: an error found of a joint that "
            "depends on its side of approach, as its play, may be the controller's error of position."
        )
    if words := assumed_in_words(dataset.header):
        out.append(words)
    twice = _repeated(dataset, rows)
    if twice:
        ids = ", ".join(twice[:4]) + (", ..." if len(twice) > 4 else "")
        out.append(
            f"{len(twice)} {'reading repeats' if len(twice) == 1 else 'readings repeat'} an earlier one to the last "
            f"digit, joints and measured numbers ({ids}): counted twice, they make errors look smaller."
        )
    if dataset.weightless and "compliance" in dataset.header.groups:
        out.append(
            "No masses are known, so gravity is not modelled and no compliance is identified: a real arm of 0.6 m "
            "reach was then off by 0.31 instead of 0.11 mm. Give [[loads]] in the header, or the mass of the arm with "
            "'truepose robot import --mass'."
        )
    robot = dataset.header.robot
    numbers = [axis.removeprefix("j") for axis in robot.axes]
    joints = dataset.conditions.joints[rows] / robot.joint_units
    low, high = joints.min(axis=0), joints.max(axis=0)
    for k in np.flatnonzero(high - low < _NARROW):
        out.append(
            f"Joint {numbers[k]} moves only from {low[k]:.1f} to {high[k]:.1f} {robot.units[k]}: its parameters are "
            "hardly seen, and poses beyond are a guess."
        )
    side = dataset.conditions.side[rows]
    one_sided = np.flatnonzero(np.ptp(side, axis=0) == 0.0)
    if len(one_sided):
        names = ", ".join(numbers[k] for k in one_sided)
        out.append(
            f"{'Joint' if len(one_sided) == 1 else 'Joints'} {names} always arrived from the same side: backlash "
            "there is invisible, and the result holds for that approach."
        )
    return out


def _repeated(dataset: Dataset, rows: NDArray[np.bool_]) -> list[str]:
    """List the ids of readings that equal an earlier one.

    A length alone is one number, so its time must be the same too.
    """
    time = np.where(dataset.pointed, 0.0, dataset.conditions.time)
    numbers = np.nan_to_num(
        np.column_stack(
            [dataset.conditions.joints, dataset.points, dataset.orientation, dataset.lengths, time]
        )
    )
    seen: set[bytes] = set()
    out = []
    for i, key in zip(np.flatnonzero(rows).tolist(), row_keys(numbers[rows]), strict=True):
        if key in seen:
            out.append(dataset.reading_id[i])
        seen.add(key)
    return out


@dataclass(frozen=True)
class MixedReadings:
    """The smaller group of mixed readings.

    Attributes
    ----------
    rows : array of int, shape (m,)
        Index of the readings.
    miss : float
        Median distance by which the robot misses them if it fits the others, mm.
    offset : array of shape (3,) or None
        Offset of their target in the flange frame, mm; None if they are from another station.
    """

    rows: NDArray[np.int64]
    miss: float
    offset: Array | None


def mixture(meaning: InterpretedReadings, tools: Array) -> MixedReadings | None:
    """Find readings from another station, or of another target, than most.

    Returns None if all are of one kind, or if the remaining readings do not agree. `tools` (T, 3) are
    nominal targets, mm.
    """
    assert meaning.points is not None
    measured, turn = meaning.points, meaning.flange[:, :3, :3]
    nominal = meaning.flange[:, :3, 3] + np.einsum("nij,nj->ni", turn, tools[meaning.which])
    near = _NEAR * extent_of(nominal)
    plain = _missed(nominal, measured, np.ones(len(nominal), dtype=np.bool_))
    if np.mean(plain < near) >= _MOST:
        return None
    these, miss = _agreeing(nominal, measured, near)
    rest = np.flatnonzero(~these)
    if not _LEAST <= these.mean() < _MOST or len(rest) < _TARGET:
        return None
    left = float(np.median(miss[these]))
    rotation, shift = align(nominal[these], measured[these], np.ones(int(these.sum())))
    off = np.einsum("nji,nj->ni", turn[rest], (measured[rest] - shift) @ rotation - nominal[rest])
    offset = np.median(off, axis=0)
    # Where it is another target of the header's, the fit gives the reading its right name
    named = np.linalg.norm(tools[meaning.which[rest]] + offset - tools[:, None], axis=2).min() < near
    apart = np.linalg.norm(off - offset, axis=1)
    if not named and _alike(apart, miss[rest], near, left):
        return MixedReadings(rest, float(np.median(miss[rest])), offset)
    if len(rest) < _STATION:
        return None
    _, apart = _agreeing(nominal[rest], measured[rest], near)
    return (
        MixedReadings(rest, float(np.median(miss[rest])), None)
        if _alike(apart, miss[rest], near, left)
        else None
    )


def _alike(apart: Array, together: Array, near: float, left: float) -> bool:
    """Test whether readings are of one separate kind.

    They are missed by `together` (n,), mm, as part of all readings, and by `apart` (n,), mm, as a
    separate kind. `left` is the median miss of the other kind.
    """
    clearly = np.median(together) > BETTER * max(left, float(np.median(apart)))
    return bool(clearly and np.mean(apart < near) >= _MOST)


def _agreeing(nominal: Array, measured: Array, near: float) -> tuple[NDArray[np.bool_], Array]:
    """Find the placement of the robot that brings most points near (random triples).

    Returns whether each point is near, and its distance there, mm, both (n,).
    """
    rng = np.random.default_rng(0)
    triples = rng.random((_TRIES, len(nominal))).argpartition(2, axis=1)[:, :3]
    best = max(
        (_missed(nominal, measured, chosen) for chosen in triples),
        key=lambda miss: int(np.sum(miss < near)),
    )
    for _ in range(_ROUNDS):
        best = _missed(nominal, measured, best < near)
    return best < near, best


def _missed(nominal: Array, measured: Array, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Array:
    """Compute the distances of all points with the robot placed by the chosen ones, (n,), mm."""
    rotation, shift = align(nominal[chosen], measured[chosen], np.ones(len(nominal[chosen])))
    return np.linalg.norm(measured - nominal @ rotation.T - shift, axis=1)
