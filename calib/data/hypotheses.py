"""Hypotheses about the meaning of data files: signs, order, zeros, rows, units, robots.

Each hypothesis changes one thing in the files. `explained` puts the nominal robot in its place under
each of them. If the robot then misses the readings at least five times less than with the unchanged
files, the hypothesis is the likelier meaning. The tool is taken as the header gives it and, in a second
round, as unknown, so that a wrong tool explains nothing but itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import forward
from calib.arm.robot import Convention, Robot, built_in_robots, load_robot
from calib.arm.start import base_and_tool, base_target
from calib.array import Array
from calib.units import DEG

FEWEST = 8
"""Readings that can show what else the files mean."""
BETTER = 5.0
"""Ratio of misses from which on a hypothesis is believed."""

# Miss of the nominal robot, as a share of the extent of the readings, that asks for no explanation
_SMALL = 0.02
_MOST = 0.75  # of the readings, by which a meaning is judged
_EXPLAINED = 0.03  # the same, that a believed hypothesis may leave
_ALIKE = 1.5  # ratio of misses within which two hypotheses count as alike
_SAME = 1.01  # the same, within which they say the same of the readings
_UNITS = {"metres": 1000.0, "inches": 25.4, "centimetres": 10.0, "micrometres": 0.001}
_LATEST = 3  # rows by which a column may have slipped
_SEEN = 1e-3  # sine of alpha from which on its sign shows
_METRES = 20.0  # mm: an arm with a smaller reach is written in metres
# Share of the reach: by so much the right arm's nominal table may miss, so that no other arm is suspected, and what it
# misses is explained however small the extent
_NOMINAL = 0.005

_PER_COLUMN = 3.0  # measured numbers for each of a geometry that is to be free
_STEP = 1e-3  # rad: about as far as 1 mm at arm's length
_FLAT = 1e-3  # of the largest singular value: what the readings hardly show stays nominal
_ROBUST = 4  # rounds of reweighting
_NEAR = 10.0  # mm, mrad: an arm as it was made

File = Literal["data", "header"]


@dataclass(frozen=True)
class InterpretedReadings:
    """Readings of one series according to the files, or to a hypothesis.

    Attributes
    ----------
    robot : Robot
        Nominal robot.
    angles : array of shape (n, N)
        Controller angles, rad.
    which : array of int, shape (n,)
        Index of the tool target.
    points : array of shape (n, 3) or None
        Measured points, mm; None if distances were measured.
    lengths, anchor : array of shape (n,) or None
        Measured distances, mm, and index of their base target.
    tool_factor : float
        Factor for the tool targets of the header.
    """

    robot: Robot
    coupling: str
    angles: Array
    which: NDArray[np.int64]
    points: Array | None
    lengths: Array | None = None
    anchor: NDArray[np.int64] | None = None
    tool_factor: float = 1.0

    @cached_property
    def flange(self) -> Array:
        """Poses of the nominal flange, shape (n, 4, 4), mm."""
        return forward(self.robot, self.robot.model_angles(self.angles, self.coupling))

    def miss(self, tools: Array, *, tool_unknown: bool, zero_unknown: bool) -> tuple[float, float]:
        """Compute by how much the nominal robot in its best place misses the readings, mm.

        Returns the distance within which three quarters of the readings lie, and their extent, mm. The
        extent is that of the points or that of the flange, whichever is larger, because the flange may
        turn about points. With distances it is that of the nominal targets. A median would not show that
        every third reading of three targets has slipped.
        """
        turn, place = self.flange[:, :3, :3], self.flange[:, :3, 3]
        tools = self.tool_factor * tools
        if self.points is None:
            nominal = place + np.einsum("nij,nj->ni", turn, tools[self.which])
            return self._miss_of_lengths(nominal, zero_unknown=zero_unknown), extent_of(nominal)
        pose, tool = base_and_tool(self.flange, tools, self.which, self.points, tool_unknown=tool_unknown)
        there = (place + np.einsum("nij,nj->ni", turn, tool[self.which])) @ pose[:3, :3].T + pose[:3, 3]
        return float(np.quantile(np.linalg.norm(self.points - there, axis=1), _MOST)), max(
            extent_of(self.points), extent_of(place)
        )

    def miss_of_near(self, tools: Array) -> tuple[float, float]:
        """Compute `miss` for the robot whose geometry fits best, to first order.

        Also returns the largest change from the nominal geometry, mm or mrad. Both are infinite if there
        are too few points.
        """
        robot, keys = self.robot, ("alpha", "a", "theta", "d")
        if self.points is None or 3 * len(self.points) < _PER_COLUMN * (4 * robot.joints + 9):
            return np.inf, np.inf
        pose, tool = base_and_tool(
            self.flange, self.tool_factor * tools, self.which, self.points, tool_unknown=True
        )
        turned = robot.model_angles(self.angles, self.coupling)

        def points(of: Robot) -> Array:
            flange = forward(of, turned)
            arm = flange[:, :3, 3] + np.einsum("nij,nj->ni", flange[:, :3, :3], tool[self.which])
            return arm @ pose[:3, :3].T

        here, columns = points(robot), []
        for key in keys:
            step = _STEP if key in ("alpha", "theta") else 1.0
            for k, value in enumerate(getattr(robot, key)):
                numbers = getattr(robot, key)
                moved = replace(robot, **{key: (*numbers[:k], value + step, *numbers[k + 1 :])})
                columns.append(points(moved) - here)
        columns += [np.cross(axis, here) * _STEP for axis in np.eye(3)]
        columns += [np.broadcast_to(axis, here.shape) for axis in np.eye(3)]
        turn = pose[:3, :3] @ self.flange[:, :3, :3]
        for target in np.unique(self.which):
            of = (self.which == target)[:, None]
            columns += [np.where(of, turn[:, :, axis], 0.0) for axis in range(3)]
        matrix, right = np.stack(columns, axis=-1), self.points - here - pose[:3, 3]
        left, change = right, np.zeros(matrix.shape[2])
        for _ in range(_ROBUST):
            size = np.linalg.norm(left, axis=1)
            weight = np.sqrt(np.minimum(1.0, 2.0 * np.median(size) / np.maximum(size, 1e-9)))[:, None]
            by_row = (matrix * weight[:, :, None]).reshape(-1, matrix.shape[2])
            change, *_ = np.linalg.lstsq(by_row, (right * weight).ravel(), rcond=_FLAT)
            left = right - matrix @ change
        far = np.abs(change[: len(keys) * robot.joints]).max()
        return float(np.quantile(np.linalg.norm(left, axis=1), _MOST)), float(far)

    def _miss_of_lengths(self, nominal: Array, *, zero_unknown: bool) -> float:
        assert self.lengths is not None
        assert self.anchor is not None
        miss = []
        for a in np.unique(self.anchor):
            of = self.anchor == a
            place = base_target(nominal[of], self.lengths[of], zero_unknown=zero_unknown)
            if of.sum() >= FEWEST and place is not None:
                off = self.lengths[of] - np.linalg.norm(nominal[of] - place, axis=1)
                miss.append(np.abs(off - zero_unknown * np.median(off)))
        return float(np.quantile(np.concatenate(miss), _MOST)) if miss else np.inf


@dataclass(frozen=True)
class JointCounting:
    """A counting of the joints, in rad, or mm for joints that slide.

    joint of the robot = matrix (N, N) @ joint of the file + offset (N,).
    """

    matrix: Array
    offset: Array

    def of(self, meaning: InterpretedReadings) -> InterpretedReadings:
        """Count the joints of readings by this matrix."""
        return replace(meaning, angles=meaning.angles @ self.matrix.T + self.offset)


@dataclass(frozen=True)
class Hypothesis:
    """A hypothesis about the files: the error, its remedy, and the file and key of it.

    Attributes
    ----------
    counting : JointCounting or None
        Counting of the joints, if the hypothesis is about them and a robot file could state it too.
    least_mm : float
        The hypothesis is not considered if the unchanged files miss by less, mm.
    """

    what: str
    do: str
    file: File
    key: str
    meaning: InterpretedReadings
    counting: JointCounting | None = None
    least_mm: float = 0.0


@dataclass(frozen=True)
class Explanation:
    """The likeliest meaning of readings that the unchanged files do not explain.

    `equals` and `rivals` are in the order in which they were tried, the simpler ones first, since
    rounding decides which of them leaves least.

    Attributes
    ----------
    equals : tuple of Hypothesis
        Other hypotheses with the same miss, to 1 %.
    rivals : tuple of Hypothesis
        Those with up to half more.
    miss, left : float
        Distance within which the nominal robot comes to three quarters of the readings, mm: with the
        unchanged files, and with `cause`.
    """

    cause: Hypothesis
    equals: tuple[Hypothesis, ...]
    rivals: tuple[Hypothesis, ...]
    miss: float
    left: float


def explained(
    meaning: InterpretedReadings,
    others: Callable[[], Iterator[Hypothesis]],
    tools: Array,
    *,
    tool_unknown: bool,
    zero_unknown: bool,
    tool_as_given: bool = False,
) -> Explanation | None:
    """Find the hypothesis that explains the readings clearly better than the files do.

    Parameters
    ----------
    meaning : InterpretedReadings
        Readings according to the files.
    others : callable
        Yields the hypotheses to try, the simpler ones first.
    tools : array of shape (T, 3)
        Nominal tool targets, mm.
    tool_unknown : bool
        Whether the tool is unknown.
    zero_unknown : bool
        Whether the zero of lengths is unknown.
    tool_as_given : bool, optional
        Use only these targets, since many hypotheses at once can have the effect of a tool of another length.

    Returns
    -------
    Explanation or None
        None if no hypothesis is better, or none is needed.
    """

    def missed(of: InterpretedReadings, free: bool) -> tuple[float, float]:
        """Compute the miss, mm, and as a share of the extent of the readings."""
        miss, extent = of.miss(tools, tool_unknown=free, zero_unknown=zero_unknown)
        return miss, miss / max(extent, 1e-9)

    for free in (False,) if tool_as_given else (False, True):
        if free < tool_unknown or (free and meaning.points is None):
            continue
        miss, plain = missed(meaning, free)
        if plain < _SMALL:
            return None
        if free:
            left_mm, far = meaning.miss_of_near(tools)
            if BETTER * left_mm < miss and far < _NEAR:
                return None
        limit, near_mm = plain / BETTER, _NOMINAL * reach(meaning.robot)
        if not free and meaning.points is not None:
            limit = min(limit, 2.0 * missed(meaning, True)[1])  # a wrong tool must not explain it better
        # The others are let go at once, with their poses: of twenty joints there are twenty thousand pairs. In mm, too,
        # an explanation is better: another unit alone makes the extent ten times as large, and the share small.
        shares = [
            (left, other)
            for other in others()
            if other.least_mm <= miss
            for left_mm, left in (missed(other.meaning, free),)
            if left < _SAME * limit and BETTER * left_mm < _SAME * miss
            if left < _EXPLAINED or left_mm < near_mm
        ]
        least = min((left for left, _ in shares), default=np.inf)
        if least < limit:
            cause, *equals = (other for left, other in shares if left < _SAME * least)
            rivals = (other for left, other in shares if _SAME * least <= left < _ALIKE * least)
            return Explanation(cause, tuple(equals), tuple(rivals), miss, missed(cause.meaning, free)[0])
    return None


def slipped(meaning: InterpretedReadings, others: Iterator[Hypothesis], tools: Array) -> Explanation | None:
    """Find the hypothesis about rows that a robot near the nominal one follows clearly better.

    The robot may have any geometry near the nominal one. Along a path of short steps the nominal robot
    itself misses by as much as the next row is away. Returns None if there is no such hypothesis.
    """
    plain, _ = meaning.miss_of_near(tools)
    found = [(other.meaning.miss_of_near(tools)[0], other) for other in others]
    left, cause = min(found, default=(np.inf, None), key=lambda each: each[0])
    if cause is None or BETTER * left > plain or not np.isfinite(plain):
        return None
    equals = tuple(other for miss, other in found if other is not cause and miss < _SAME * left)
    return Explanation(cause, equals, (), plain, left)


def of_robot(meaning: InterpretedReadings) -> Iterator[Hypothesis]:
    """Yield hypotheses about the robot: another one, another joint matrix, a misread file.

    Only the user's own robot file can be misread.
    """
    robot, built_in = meaning.robot, {name: load_robot(name) for name in built_in_robots()}
    for name, other in built_in.items():
        for coupling in ("none", *other.joint_matrices):
            if other.joints == robot.joints and other != robot:
                counted = "" if coupling == meaning.coupling else f' and joint_coupling = "{coupling}"'
                yield Hypothesis(
                    f"the readings are not of the robot {robot.name}: they fit {name}",
                    f'Set robot = "{name}"{counted}.',
                    "header",
                    "robot",
                    replace(meaning, robot=other, coupling=coupling),
                    least_mm=_NOMINAL * reach(robot),
                )
    for coupling in ("none", *robot.joint_matrices):
        if coupling != meaning.coupling:
            yield Hypothesis(
                f"the joints are not counted with joint_coupling = {meaning.coupling!r}",
                f'Set joint_coupling = "{coupling}".',
                "header",
                "joint_coupling",
                replace(meaning, coupling=coupling),
            )
    if robot not in built_in.values():
        yield from of_table(meaning)


def of_table(meaning: InterpretedReadings) -> Iterator[Hypothesis]:
    """Yield hypotheses about the table of the robot file.

    They are about its units, its convention, signs, and exchanged columns or rows.
    """
    robot = meaning.robot

    def misread(what: str, do: str, **changes: tuple[float, ...] | Convention) -> Hypothesis:
        return Hypothesis(
            f"the file of the robot {robot.name} {what}",
            do,
            "header",
            "robot",
            replace(meaning, robot=replace(robot, **changes)),
        )

    for unit, factor in (("metres", 1000.0), ("inches", 25.4)):
        if unit == "inches" or reach(robot) < _METRES:
            yield misread(
                f"has its lengths in {unit}",
                f"Multiply every a_mm and d_mm by {factor:g}.",
                a=tuple(factor * x for x in robot.a),
                d=tuple(factor * x for x in robot.d),
            )
    yield misread(
        "has its angles in radians",
        "Write alpha_deg and theta_deg in degrees.",
        alpha=tuple(x / DEG for x in robot.alpha),
        theta=tuple(x / DEG for x in robot.theta),
    )
    written, convention = ("modified", "dh") if robot.convention == "mdh" else ("standard", "mdh")
    yield misread(
        f"does not hold {written} DH numbers, as its convention says",
        f'Set convention = "{convention}" in the robot file.',
        convention=convention,
    )
    yield misread("has a_mm and d_mm in each other's place", "Exchange a_mm and d_mm.", a=robot.d, d=robot.a)
    for k, (alpha, a, d) in enumerate(zip(robot.alpha, robot.a, robot.d, strict=True)):
        for key, value, unit, there in (
            ("alpha", alpha, "deg", abs(np.sin(alpha)) > _SEEN),
            ("a", a, "mm", bool(a)),
            ("d", d, "mm", bool(d)),
        ):
            if there:
                numbers = getattr(robot, key)
                shown = -value / DEG if unit == "deg" else -value
                yield misread(
                    f"has {key}_{unit} of link {k + 1} with the wrong sign",
                    f"Write {key}_{unit} = {shown:g} for link {k + 1}.",
                    **{key: (*numbers[:k], -value, *numbers[k + 1 :])},
                )
    for k in range(robot.joints - 1):
        order = [*range(k), k + 1, k, *range(k + 2, robot.joints)]
        yield misread(
            f"has links {k + 1} and {k + 2} in each other's place",
            f"Exchange the tables [[link]] of links {k + 1} and {k + 2}.",
            alpha=tuple(robot.alpha[i] for i in order),
            a=tuple(robot.a[i] for i in order),
            theta=tuple(robot.theta[i] for i in order),
            d=tuple(robot.d[i] for i in order),
        )


def of_points(meaning: InterpretedReadings) -> Iterator[Hypothesis]:
    """Yield hypotheses that points are mirrored, or that points or distances have another unit."""
    if reach(meaning.robot) < _METRES:
        return  # the robot file is in the wrong unit, not the readings
    points, lengths = meaning.points, meaning.lengths
    if points is not None:
        yield Hypothesis(
            "the measured frame is left-handed: mirrored, its points fit the robot",
            "Change the sign of one axis, or swap two columns, as the instrument's manual has it.",
            "data",
            "x_mm, y_mm, z_mm",
            replace(meaning, points=points * (-1.0, 1.0, 1.0)),
        )
    for unit, factor in _UNITS.items():
        yield Hypothesis(
            f"the measured numbers are {unit}, not millimetres",
            f"Multiply them by {factor:g}.",
            "data",
            "length_mm" if points is None else "x_mm, y_mm, z_mm",
            replace(
                meaning,
                points=None if points is None else points * factor,
                lengths=None if lengths is None else lengths * factor,
            ),
        )


def of_tools(meaning: InterpretedReadings, names: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield hypotheses about the tool targets of the header: another unit, or two exchanged."""
    for unit, factor in _UNITS.items():
        yield Hypothesis(
            f"the tool targets are in {unit}, not millimetres",
            f"Multiply them by {factor:g}.",
            "header",
            "tool_targets",
            replace(meaning, tool_factor=factor),
        )
    for one, other in combinations(np.unique(meaning.which).tolist(), 2):
        swapped = meaning.which.copy()
        swapped[meaning.which == one], swapped[meaning.which == other] = other, one
        yield Hypothesis(
            f"the tool targets {names[one]} and {names[other]} are in each other's place",
            f"Exchange {names[one]} and {names[other]} under [tool_targets], or in the column tool_target.",
            "header",
            "tool_targets",
            replace(meaning, which=swapped),
        )


def of_rows(
    everything: InterpretedReadings, rows: NDArray[np.int64], usable: NDArray[np.bool_]
) -> Iterator[Hypothesis]:
    """Yield hypotheses that the measured columns have slipped by up to three rows.

    Parameters
    ----------
    everything : InterpretedReadings
        Every row of the file.
    rows : array of int, shape (n,)
        Index of the rows to examine.
    usable : array of bool
        For every row of the file, whether it may be used for this series.
    """
    for late in (*range(1, _LATEST + 1), *range(-1, -_LATEST - 1, -1)):
        inside = rows[(rows + late >= 0) & (rows + late < len(usable))]
        here = inside[usable[inside + late]]
        if len(here) < FEWEST:
            continue
        there = here + late
        how, where = ("late", "up") if late > 0 else ("early", "down")
        for named_with in (here, there):  # the names of the targets may have slipped too
            yield Hypothesis(
                f"what was measured is {abs(late)} row{'s' * (abs(late) > 1)} too {how} beside the joints",
                f"Move the measured columns {abs(late)} row{'s' * (abs(late) > 1)} {where}.",
                "data",
                "length_mm" if everything.points is None else "x_mm, y_mm, z_mm",
                InterpretedReadings(
                    everything.robot,
                    everything.coupling,
                    everything.angles[here],
                    everything.which[named_with],
                    None if everything.points is None else everything.points[there],
                    None if everything.lengths is None else everything.lengths[there],
                    None if everything.anchor is None else everything.anchor[there],
                ),
            )


def both(one: Hypothesis, other: Hypothesis) -> Hypothesis:
    """Two mistakes at once; `other` is a hypothesis about what `one` says that the files mean."""
    keys = dict.fromkeys(f"{one.key}, {other.key}".split(", "))
    return replace(
        other, what=f"{one.what}, and {other.what}", do=f"{one.do} {other.do}", key=", ".join(keys)
    )


def reach(robot: Robot) -> float:
    """Sum the lengths of the links, mm."""
    return float(np.sum(np.abs([*robot.a, *robot.d])))


def extent_of(points: Array) -> float:
    """Root of the summed variances of points (n, 3), mm."""
    return float(np.linalg.norm(np.std(points, axis=0)))
