"""The nominal robot, as its maker describes it: DH numbers, joint limits, loads, how the controller counts.

Read from `calib/arm/robots/NAME.toml` (`format = "truepose-robot/1"`) or from a file of the user's own. Two
conventions: modified DH (Craig), `Rx(alpha) Ry(beta) Tx(a) Rz(theta) Tz(d)`, and standard DH,
`Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)`; beta is Hayati's twist between axes that are meant to be parallel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from calib.arm.capsules import Capsule, default_capsules, parse_capsules
from calib.errors import DataError
from calib.text.toml_text import read_toml
from calib.units import DEG

FORMAT = "truepose-robot/1"
BUILT_IN = Path(__file__).parent / "robots"

MOST_JOINTS = 20
FARTHEST_MM = 1e5
MOST_TURN = 1e4 * DEG
HEAVIEST_KG = 1e5
"""No link is longer or heavier, no joint turns further: what is was given in another unit."""

Convention = Literal["mdh", "dh"]
BasePlacement = Literal["plain", "thesis"]


@dataclass(frozen=True)
class Load:
    """A mass that loads the joints: on link `link` (1-based), kg, centre of gravity in that link's frame, mm."""

    link: int
    mass_kg: float
    cog_mm: tuple[float, float, float]


@dataclass(frozen=True)
class JointMatrix:
    """model angle = matrix @ controller angle + offset (rad)."""

    matrix: tuple[tuple[float, ...], ...]
    offset: tuple[float, ...]


@dataclass(frozen=True)
class Robot:
    """Nominal robot of N joints; angles in rad, lengths in mm, arrays of shape (N,)."""

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

    @property
    def joints(self) -> int:
        """Number of joints N."""
        return len(self.theta)

    @cached_property
    def geometric_links(self) -> tuple[tuple[str, int], ...]:
        """The DH numbers that identification frees, as (kind, link): those the base pose cannot absorb.

        Modified DH: alpha, a, theta, d of links 2..N. Standard DH: alpha and a of link 1 as well, since there
        they come behind theta_1 (leaving them out costs 0.66 mm on a UR10).
        """
        kinds = ("alpha", "a", "theta", "d")
        first = [("alpha", 1), ("a", 1)] if self.convention == "dh" else []
        return tuple(first + [(kind, link) for link in range(2, self.joints + 1) for kind in kinds])

    @cached_property
    def body(self) -> tuple[Capsule, ...]:
        """The capsules of the robot file, or where it has none what encloses most arms of this length."""
        return self.capsules or default_capsules(self.convention, self.alpha, self.a, self.d)

    def model_angles(self, controller: NDArray[np.float64], coupling: str) -> NDArray[np.float64]:
        """(n, N) controller angles -> (n, N) model angles, rad. Raises KeyError for an unknown `coupling`."""
        if coupling == "none":
            return controller
        joint_matrix = self.joint_matrices[coupling]
        return controller @ np.array(joint_matrix.matrix).T + np.array(joint_matrix.offset)

    def controller_angles(self, model: NDArray[np.float64], coupling: str) -> NDArray[np.float64]:
        """(..., N) model angles -> (..., N) controller angles, rad: the inverse of `model_angles`.

        Raises KeyError for an unknown `coupling`.
        """
        if coupling == "none":
            return model
        joint_matrix = self.joint_matrices[coupling]
        return (model - np.array(joint_matrix.offset)) @ np.linalg.inv(np.array(joint_matrix.matrix)).T


def built_in_robots() -> list[str]:
    """Names of the robots that come with the program."""
    return sorted(path.stem for path in BUILT_IN.glob("*.toml"))


def load_robot(name: str, beside: Path | None = None) -> Robot:
    """Read a built-in robot by name, or a robot file by path (relative to `beside`, a folder).

    Raises DataError when there is no such robot or its file is not a robot file.
    """
    path = BUILT_IN / f"{name}.toml"
    if name not in built_in_robots():
        path = (beside or Path()) / name
        if path.suffix != ".toml" or not _is_file(path):
            raise DataError(
                f"unknown robot '{name}'.",
                do=f"Use one of {', '.join(built_in_robots())}, or the path of a robot .toml file.",
                key="robot",
            )
    return _robot_from(read_toml(path)[1], path)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long
        return False


def _robot_from(table: dict[str, Any], path: Path) -> Robot:
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
        matrices = {
            name: JointMatrix(
                tuple(tuple(float(x) for x in row) for row in entry["matrix"]),
                tuple(float(x) * DEG for x in entry.get("offset_deg", [0.0] * joints)),
            )
            for name, entry in table.get("joint_matrices", {}).items()
        }
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
            lower=tuple(float(link["min_deg"]) * DEG for link in links),
            upper=tuple(float(link["max_deg"]) * DEG for link in links),
            parallel_axes=tuple(int(k) for k in table.get("parallel_axes", ())),
            loads=parse_loads(table.get("loads", []), joints, path),
            joint_matrices=matrices,
            controller_world_mm=_three(table.get("controller_world_mm", (0.0, 0.0, 0.0))),
            source=table["source"],
            capsules=parse_capsules(table.get("capsule", []), joints, path),
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


def _three(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def refuse_impossible(robot: Robot, path: Path) -> None:
    """Raise DataError, naming the key, for a robot that no maker can build."""
    for key, value in (("name", robot.name), ("maker", robot.maker), ("source", robot.source)):
        if not isinstance(value, str) or not value:
            raise DataError(f"is {value!r}.", do="Give text.", file=path, key=key)
    if not 1 <= robot.joints <= MOST_JOINTS:
        raise DataError(
            f"there are {robot.joints} links.", do=f"Give 1 to {MOST_JOINTS}.", file=path, key="link"
        )
    lengths = (*robot.a, *robot.d, *robot.controller_world_mm)
    angles = (*robot.alpha, *robot.theta, *robot.lower, *robot.upper)
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
        if not np.all(np.abs(numbers) <= MOST_TURN) or abs(np.linalg.det(np.array(each.matrix))) < 1e-6:
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
    if not all(low < high for low, high in zip(robot.lower, robot.upper, strict=True)):
        raise DataError("a joint's min_deg is not below its max_deg.", do="Correct the limits.", file=path)


def parse_loads(entries: Any, joints: int, path: Path | str) -> tuple[Load, ...]:
    """The `[[loads]]` of a robot file or a data set. Raises DataError when they are not physical."""
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise DataError(
            "is not a list of tables.", do="Write every load as [[loads]].", file=path, key="loads"
        )
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
            f"a load is not made of numbers ({error}).",
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
