"""The nominal robot, as its maker describes it: DH numbers, joint limits, loads, how the controller counts.

Read from `calib/robots/NAME.toml` (`format = "truepose-robot/1"`) or from a file of the user's own. Two
conventions: modified DH (Craig), `Rx(alpha) Ry(beta) Tx(a) Rz(theta) Tz(d)`, and standard DH,
`Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)`; beta is Hayati's twist between axes that are meant to be parallel.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from calib.capsules import Capsule, default_capsules, parse_capsules
from calib.errors import DataError
from calib.units import DEG

FORMAT = "truepose-robot/1"
BUILT_IN = Path(__file__).parent / "robots"

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
        they stand behind theta_1 (leaving them out costs 0.66 mm on a UR10).
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
    if not path.is_file():
        path = (beside or Path()) / name
        if path.suffix != ".toml" or not path.is_file():
            raise DataError(
                f"unknown robot '{name}'.",
                do=f"Use one of {', '.join(built_in_robots())}, or the path of a robot .toml file.",
                key="robot",
            )
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DataError(f"is not valid TOML ({error}).", do="Correct the file.", file=path) from error
    return _robot_from(table, path)


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
            parallel_axes=tuple(table.get("parallel_axes", ())),
            loads=parse_loads(table.get("loads", []), joints, path),
            joint_matrices=matrices,
            controller_world_mm=tuple(table.get("controller_world_mm", (0.0, 0.0, 0.0))),
            source=table["source"],
            capsules=parse_capsules(table.get("capsule", []), joints, path),
        )
    except DataError:
        raise
    except (TypeError, ValueError, AttributeError) as error:
        raise DataError(
            f"has a value of the wrong kind ({error}).", do="See the built-in robot files.", file=path
        ) from error
    except KeyError as error:
        raise DataError(
            "key is missing.", do="Add it; see the built-in robot files.", file=path, key=error.args[0]
        ) from error
    _refuse_impossible(robot, path)
    return robot


def _refuse_impossible(robot: Robot, path: Path) -> None:
    numbers = (*robot.alpha, *robot.a, *robot.theta, *robot.d, *robot.lower, *robot.upper)
    if not all(math.isfinite(x) for x in numbers):
        raise DataError("a link has a number that is not finite.", do="Correct it.", file=path, key="link")
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
    if not (mass > 0.0 and all(math.isfinite(x) for x in (mass, *cog))):
        raise DataError(
            f"a load of {mass} kg cannot be.",
            do="Give its mass in kg, above zero.",
            file=path,
            key="loads",
        )
    return Load(link, mass, (cog[0], cog[1], cog[2]))
