"""The nominal robot of its maker: DH parameters, joint limits, loads and joint matrices.

It is read from `calib/arm/robots/NAME.toml` (`format = "truepose-robot/1"`) or from the user's own file.
There are two conventions. Modified DH (Craig) is `Rx(alpha) Ry(beta) Tx(a) Rz(theta) Tz(d)`. Standard DH
is `Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)`. beta is Hayati's twist between axes that are meant to be
parallel. A joint that turns adds to theta, one that slides to d.

The hash of a robot covers all numbers on which its motion depends, but no description.

**Loads** are masses that load the joints, from the `[[loads]]` of a robot file or a data set.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from calib.arm.capsules import Capsule, default_capsules, parse_capsules
from calib.arm.joint_kinds import (
    FACTORS,
    UNITS,
    JointKind,
    JointMatrix,
    external_of,
    kind_of,
    limits_of,
    parse_joint_matrix,
)
from calib.array import Array
from calib.errors import DataError
from calib.text.flags import refuse_flags
from calib.text.toml_table import did_you_mean, read_toml, refuse_unknown
from calib.units import DEG

FARTHEST_MM = 1e5

HEAVIEST_KG = 1e5

"""No link is longer or heavier: what is was given in another unit."""


@dataclass(frozen=True)
class Load:
    """A mass on link `link` (1-based), kg, with its centre of gravity in that link's frame, mm."""

    link: int
    mass_kg: float
    cog_mm: tuple[float, float, float]


def parse_loads(entries: Any, joints: int, path: Path | str) -> tuple[Load, ...]:
    """Parse the `[[loads]]` of a robot file or a data set.

    Raises
    ------
    DataError
        A load is incomplete or not physical.
    """
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise DataError(
            "is not a list of tables.", do="Write every load as [[loads]].", file=path, key="loads"
        )
    refuse_flags(entries, path, "loads")
    return tuple(_load(entry, joints, path) for entry in entries)


def _load(entry: Mapping[str, Any], joints: int, path: Path | str) -> Load:
    try:
        link = entry["link"]
        mass, cog = float(entry["mass_kg"]), tuple(float(x) for x in entry["cog_mm"])
    except KeyError as error:
        raise DataError(
            "a load lacks this key.", do="Give link, mass_kg, cog_mm.", file=path, key=error.args[0]
        ) from error
    except (TypeError, ValueError) as error:
        raise DataError(
            f"a load has a value that is not a number ({error}).",
            do="Give link (a joint's number), mass_kg and cog_mm = [x, y, z].",
            file=path,
            key="loads",
        ) from error
    if type(link) is not int or not 1 <= link <= joints or len(cog) != 3:
        raise DataError(
            f"a load names link {link} with {len(cog)} coordinates.",
            do=f"Use a link from 1 to {joints} and three coordinates in mm.",
            file=path,
            key="loads",
        )
    if not (0.0 < mass <= HEAVIEST_KG and all(abs(x) <= FARTHEST_MM for x in cog)):
        raise DataError(
            f"a load of {mass} kg is not possible.",
            do=f"Give its mass in kg, above zero, and its centre within {FARTHEST_MM:g} mm.",
            file=path,
            key="loads",
        )
    return Load(link, mass, (cog[0], cog[1], cog[2]))


FORMAT = "truepose-robot/1"

BUILT_IN = Path(__file__).parent / "robots"

MOST_JOINTS = 20

MOST_TURN = 1e4 * DEG

"""No joint turns further: what does was given in another unit."""

Convention = Literal["mdh", "dh"]

BasePlacement = Literal["plain", "thesis"]

_KEYS = (
    *("format", "name", "maker", "convention", "base", "parallel_axes", "source", "link", "loads"),
    *("loads_estimated", "joint_matrices", "controller_world_mm", "capsule"),
)

_NO_ROOM = 0.1  # deg or mm between the limits of a joint that follows others

_LEANS = 10.0 * DEG

"""Axes that lean by more are not meant to be parallel."""

DESCRIPTION = ("name", "maker", "source", "capsules")

"""Keys of a robot that are words, or its capsules, and move nothing."""


@dataclass(frozen=True)
class Robot:
    """A nominal robot of N joints; angles in rad, lengths in mm, arrays of shape (N,).

    Attributes
    ----------
    parallel_axes : tuple of int
        Links whose beta is freed. beta is the twist of the axis at the start of the link (modified DH)
        or at its end (standard DH).
    slides : tuple of int
        Links whose joint slides.
    external : tuple of (int, str)
        Link and name of the axes that are not part of the arm.
    loads_estimated : bool
        Whether the loads are estimates (`estimated_loads`) instead of published or weighed values.
    """

    name: str
    maker: str
    convention: Convention
    base: BasePlacement
    alpha: tuple[float, ...]
    a: tuple[float, ...]
    theta: tuple[float, ...]
    d: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    parallel_axes: tuple[int, ...]
    loads: tuple[Load, ...]
    joint_matrices: Mapping[str, JointMatrix]
    controller_world_mm: tuple[float, float, float]
    source: str
    capsules: tuple[Capsule, ...] = ()
    slides: tuple[int, ...] = ()
    external: tuple[tuple[int, str], ...] = ()
    loads_estimated: bool = False

    @property
    def joints(self) -> int:
        """Number of joints N."""
        return len(self.theta)

    @cached_property
    def kinds(self) -> tuple[JointKind, ...]:
        """The kind of every joint, "turns" or "slides"."""
        return tuple("slides" if k in self.slides else "turns" for k in range(1, self.joints + 1))

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Name of every axis: j1, j2, ... for joints of the arm, otherwise that of the file."""
        named, count = dict(self.external), itertools.count(1)
        return tuple(named.get(k) or f"j{next(count)}" for k in range(1, self.joints + 1))

    @cached_property
    def units(self) -> tuple[str, ...]:
        """The units in which joints are read and written outside, "deg" or "mm"."""
        return tuple(UNITS[kind] for kind in self.kinds)

    @cached_property
    def joint_columns(self) -> tuple[str, ...]:
        """The column of every joint in files: `j1_deg`, `e1_mm`."""
        return tuple(f"{axis}_{unit}" for axis, unit in zip(self.axes, self.units, strict=True))

    @cached_property
    def previous_columns(self) -> tuple[str, ...]:
        """The column of where every joint was before: `prev1_deg`, `prev_e1_mm`."""
        return tuple(f"prev{_tail(axis)}_{unit}" for axis, unit in zip(self.axes, self.units, strict=True))

    @cached_property
    def approach_columns(self) -> tuple[str, ...]:
        """The column of the side from which every joint arrived: `approach1`, `approach_e1`."""
        return tuple(f"approach{_tail(axis)}" for axis in self.axes)

    @cached_property
    def joint_units(self) -> Array:
        """Unit of every joint in files, in internal units, shape (N,).

        joints / joint_units are in deg or mm.
        """
        return np.array([FACTORS[kind] for kind in self.kinds])

    @cached_property
    def steps(self) -> Array:
        """Factors that turn a small angle, rad, into a step of each joint, shape (N,).

        A joint that slides moves as many mm as the others turn deg.
        """
        return self.joint_units / DEG

    @cached_property
    def joint_slots(self) -> tuple[str, ...]:
        """The slot of the chain that every joint drives: `theta1`, or `d1` where it slides."""
        return tuple(f"{'d' if k in self.slides else 'theta'}{k}" for k in range(1, self.joints + 1))

    @cached_property
    def geometric_links(self) -> tuple[tuple[str, int], ...]:
        """DH numbers that identification frees, as (kind, link).

        They are those that neither the base pose nor a slide absorbs. With modified DH these are alpha,
        a, theta, d of links 2 to N. With standard DH alpha and a of link 1 are included, because there
        they come behind theta_1 (leaving them out costs 0.66 mm on a UR10).

        For an axis along which a joint slides, the direction counts, but not the place. The numbers that
        shift the axis sideways therefore keep their values: the offset along the common normal, and the
        one along the axis before. (Schröer 1993: a slide has two numbers, a turn four.)
        """
        kinds = ("alpha", "a", "theta", "d")
        first = [("alpha", 1), ("a", 1)] if self.convention == "dh" else []
        free = [*first, *((kind, link) for link in range(2, self.joints + 1) for kind in kinds)]
        behind = 1 if self.convention == "dh" else 0
        across = {number for k in self.slides for number in (("a", k - behind), ("d", k - 1))}
        # The zero of a slide is its own d, also where the next axis slides.
        across -= {("d", k) for k in self.slides}
        return tuple(number for number in free if number not in across)

    @cached_property
    def body(self) -> tuple[Capsule, ...]:
        """Capsules of the robot file, or default ones that enclose most arms of this length."""
        return self.capsules or default_capsules(self.convention, self.alpha, self.a, self.d)

    def followers(self, coupling: str) -> tuple[int, ...]:
        """Find the joints (0-based) that follow others by a joint matrix.

        No motor drives them, and their limits leave them less than `_NO_ROOM` of motion.

        Raises
        ------
        KeyError
            The robot has no joint matrix `coupling`.
        """
        if coupling == "none":
            return ()
        turned_by = np.count_nonzero(self.joint_matrices[coupling].matrix, axis=1)
        room = (np.array(self.upper) - np.array(self.lower)) / self.joint_units
        return tuple(np.flatnonzero((turned_by > 1) & (room < _NO_ROOM)).tolist())

    @cached_property
    def rods(self) -> str:
        """The joint matrix by which joints follow others, `none` without."""
        return next((name for name in self.joint_matrices if self.followers(name)), "none")

    def model_angles(self, controller: Array, coupling: str) -> Array:
        """Convert joints (n, N) from controller to model values, rad or mm.

        Raises
        ------
        KeyError
            The robot has no joint matrix `coupling`.
        """
        if coupling == "none":
            return controller
        joint_matrix = self.joint_matrices[coupling]
        return controller @ np.array(joint_matrix.matrix).T + np.array(joint_matrix.offset)

    def controller_angles(self, model: Array, coupling: str) -> Array:
        """Convert joints (..., N) from model to controller values: the inverse of `model_angles`.

        Raises
        ------
        KeyError
            The robot has no joint matrix `coupling`.
        """
        if coupling == "none":
            return model
        joint_matrix = self.joint_matrices[coupling]
        return (model - np.array(joint_matrix.offset)) @ np.linalg.inv(np.array(joint_matrix.matrix)).T


def refuse_slides(robot: Robot, what: str) -> None:
    """Raise DataError for a robot with joints that slide.

    `what` is the subject of the message with its verb, for example "aligning streams knows".
    """
    if robot.slides:
        slides = ", ".join(robot.axes[k - 1] for k in robot.slides)
        raise DataError(
            f"'{robot.name}' has joints that slide ({slides}), and {what} only joints that turn.",
            do="Use identify and diagnose, which know both.",
            key="robot",
        )


def _tail(axis: str) -> str:
    return axis[1:] if axis.startswith("j") else f"_{axis}"


def built_in_robots() -> list[str]:
    """Return the names of the robots that come with the program."""
    return sorted(path.stem for path in BUILT_IN.glob("*.toml"))


def load_robot(name: str, beside: Path | None = None) -> Robot:
    """Read a built-in robot by name, or a robot file by path.

    Parameters
    ----------
    name : str
        Name of a built-in robot, or path of a robot file.
    beside : Path, optional
        Folder to which the path is relative.

    Raises
    ------
    DataError
        There is no such robot, or its file is not a robot file.
    """
    path = _path_of(name, beside)
    return robot_from(read_toml(path)[1], path)


def own_robot_table(name: str, beside: Path | None = None) -> dict[str, Any] | None:
    """Parse the robot file `name` for `robot_from`; return None for a built-in robot.

    Raises
    ------
    DataError
        There is no such robot, or the file is not TOML.
    """
    return None if name in built_in_robots() else read_toml(_path_of(name, beside))[1]


def _path_of(name: str, beside: Path | None) -> Path:
    if name in built_in_robots():
        return BUILT_IN / f"{name}.toml"
    path = (beside or Path()) / name
    if path.suffix != ".toml" or not _is_file(path):
        raise DataError(
            f"unknown robot '{name}'.",
            do=f"{did_you_mean(name, built_in_robots())}Name one of 'truepose robot list', or a robot .toml file.",
            key="robot",
        )
    return path


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long
        return False


def robot_from(table: Mapping[str, Any], path: Path) -> Robot:
    """Build a robot from a parsed robot file.

    Parameters
    ----------
    table : mapping
        The parsed file.
    path : Path
        File that error messages name.

    Raises
    ------
    DataError
        A key is missing or unknown, or a value is not possible.
    """
    if table.get("format") != FORMAT:
        raise DataError(
            f"format is {table.get('format')!r}.",
            do=f'A robot file starts with format = "{FORMAT}".',
            file=path,
        )
    try:
        links = table["link"]
        if not isinstance(links, list):
            raise DataError("is not a list.", do="Write every link as [[link]].", file=path, key="link")
        joints = len(links)
        refuse_unknown(table, _KEYS, path)
        estimated = table.get("loads_estimated", False)
        if not isinstance(estimated, bool):
            raise DataError(f"is {estimated!r}.", do="Use true or false.", file=path, key="loads_estimated")
        refuse_flags({key: value for key, value in table.items() if key != "loads_estimated"}, path, "")
        kinds: list[JointKind] = [kind_of(link, number, path) for number, link in enumerate(links, start=1)]
        limits = [limits_of(link, kind) for link, kind in zip(links, kinds, strict=True)]
        convention = table["convention"]
        if convention not in ("mdh", "dh"):
            raise DataError(f"unknown convention {convention!r}.", do="Use 'mdh' or 'dh'.", file=path)
        robot = Robot(
            name=table["name"],
            maker=table["maker"],
            convention=convention,
            base=table.get("base", "plain"),
            alpha=tuple(float(link["alpha_deg"]) * DEG for link in links),
            a=tuple(float(link["a_mm"]) for link in links),
            theta=tuple(float(link["theta_deg"]) * DEG for link in links),
            d=tuple(float(link["d_mm"]) for link in links),
            lower=tuple(low for low, _ in limits),
            upper=tuple(high for _, high in limits),
            parallel_axes=_twisted(
                table, convention, [float(link["alpha_deg"]) * DEG for link in links], path
            ),
            loads=parse_loads(table.get("loads", []), joints, path),
            joint_matrices={
                name: parse_joint_matrix(entry, kinds, path, f"joint_matrices.{name}")
                for name, entry in table.get("joint_matrices", {}).items()
            },
            controller_world_mm=_three(table.get("controller_world_mm", (0.0, 0.0, 0.0))),
            source=table["source"],
            capsules=parse_capsules(table.get("capsule", []), joints, path),
            slides=tuple(k for k, kind in enumerate(kinds, start=1) if kind == "slides"),
            external=external_of(links, path),
            loads_estimated=estimated,
        )
    except DataError:
        raise
    except (TypeError, ValueError, AttributeError) as error:  # float("x"), [1, [2]], 3["link"]
        raise DataError(
            f"has a value of the wrong kind ({error}).", do="See the built-in robot files.", file=path
        ) from error
    except KeyError as error:
        raise DataError(
            "key is missing.", do="Add it; see the built-in robot files.", file=path, key=error.args[0]
        ) from error
    refuse_impossible(robot, path)
    return robot


def _twisted(
    table: Mapping[str, Any], convention: Convention, alpha: Sequence[float], path: Path
) -> tuple[int, ...]:
    """Return the links whose beta is the twist of `parallel_axes`.

    These axes are parallel to the previous one.
    """
    axes = tuple(int(k) for k in table.get("parallel_axes", ()))
    behind, other = (1, "mdh") if convention == "dh" else (0, "dh")
    for k in axes:
        if not 2 <= k <= len(alpha):
            raise DataError(
                f"names axis {k}.",
                do=f"Name axes that are parallel to the one before, from 2 to {len(alpha)}.",
                file=path,
                key="parallel_axes",
            )
        if abs(np.sin(alpha[k - 1 - behind])) > np.sin(_LEANS):
            raise DataError(
                f"names axis {k}, but alpha_deg of link {k - behind} says that it leans "
                f"{alpha[k - 1 - behind] / DEG:g} deg against axis {k - 1}.",
                do=f'Set convention = "{other}" if these numbers are of that one. Otherwise name the second of '
                "two parallel axes (3 if axes 2 and 3 are parallel, in both conventions).",
                file=path,
                key="parallel_axes",
            )
    return tuple(k - behind for k in axes)


def _three(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def refuse_impossible(robot: Robot, path: Path) -> None:
    """Raise DataError, naming the key, for a robot that cannot be built."""
    for key, value in (("name", robot.name), ("maker", robot.maker), ("source", robot.source)):
        if not isinstance(value, str) or not value:
            raise DataError(f"is {value!r}.", do="Give text.", file=path, key=key)
    if not 1 <= robot.joints <= MOST_JOINTS:
        raise DataError(
            f"there are {robot.joints} links.", do=f"Give 1 to {MOST_JOINTS}.", file=path, key="link"
        )
    _refuse_impossible_kinds(robot, path)
    limits = list(zip(robot.kinds, robot.lower, robot.upper, strict=True))
    travel = [x for kind, *pair in limits if kind == "slides" for x in pair]
    turns = [x for kind, *pair in limits if kind == "turns" for x in pair]
    lengths = (*robot.a, *robot.d, *robot.controller_world_mm, *travel)
    angles = (*robot.alpha, *robot.theta, *turns)
    if not all(abs(x) <= FARTHEST_MM for x in lengths) or not all(abs(x) <= MOST_TURN for x in angles):
        raise DataError(
            f"a length is beyond {FARTHEST_MM:g} mm, or an angle beyond {MOST_TURN / DEG:g} deg.",
            do="Correct it.",
            file=path,
            key="link",
        )
    for name, each in robot.joint_matrices.items():
        square = np.shape(each.matrix) == (robot.joints, robot.joints) and len(each.offset) == robot.joints
        numbers = np.array([*np.ravel(each.matrix), *each.offset]) if square else np.array([np.nan])
        if not np.all(np.abs(numbers) <= FARTHEST_MM) or abs(np.linalg.det(np.array(each.matrix))) < 1e-6:
            raise DataError(
                f"is not {robot.joints} x {robot.joints} numbers that can be inverted.",
                do="Correct it.",
                file=path,
                key=f"joint_matrices.{name}",
            )
    if robot.base not in ("plain", "thesis"):
        raise DataError(f"is {robot.base!r}.", do="Use 'plain' or 'thesis'.", file=path, key="base")
    if not all(k in range(1, robot.joints + 1) for k in robot.parallel_axes):
        raise DataError(
            f"is {list(robot.parallel_axes)}.",
            do=f"Name links from 1 to {robot.joints}.",
            file=path,
            key="parallel_axes",
        )
    for kind, axis, low, high in zip(robot.kinds, robot.axes, robot.lower, robot.upper, strict=True):
        if not low < high:
            unit = UNITS[kind]
            raise DataError(
                f"min_{unit} of {axis} is not below its max_{unit}.", do="Correct the limits.", file=path
            )


def _refuse_impossible_kinds(robot: Robot, path: Path) -> None:
    links = range(1, robot.joints + 1)
    named = [link for link, _ in robot.external]
    if not all(k in links for k in (*robot.slides, *named)) or len(set(robot.axes)) != robot.joints:
        raise DataError(
            "a slide or an external axis is not one of its joints.", do="Correct them.", file=path
        )
    if robot.base == "thesis" and 1 in robot.slides:
        raise DataError(
            "is 'thesis', which needs a first joint that turns.", do="Use 'plain'.", file=path, key="base"
        )


def robot_hash(robot: Robot) -> str:
    """Compute the SHA-256 of all numbers on which a robot's motion depends.

    Without slides it is the same as in older versions. Estimated loads count as none: a better estimate
    makes no other robot, and models from before it stay valid.
    """
    table = {key: value for key, value in asdict(robot).items() if key not in DESCRIPTION}
    if table.pop("loads_estimated"):
        table["loads"] = ()
    table = {key: value for key, value in table.items() if key not in ("slides", "external") or value}
    return hashlib.sha256(json.dumps(table, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
