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

    def model_angles(self, controller: NDArray[np.float64], coupling: str) -> NDArray[np.float64]:
        """(n, N) controller angles -> (n, N) model angles, rad. Raises KeyError for an unknown `coupling`."""
        if coupling == "none":
            return controller
        joint_matrix = self.joint_matrices[coupling]
        return controller @ np.array(joint_matrix.matrix).T + np.array(joint_matrix.offset)


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
            loads=tuple(parse_load(load, joints, path) for load in table.get("loads", ())),
            joint_matrices=matrices,
            controller_world_mm=tuple(table.get("controller_world_mm", (0.0, 0.0, 0.0))),
            source=table["source"],
        )
    except KeyError as error:
        raise DataError(
            "key is missing.", do="Add it; see the built-in robot files.", file=path, key=error.args[0]
        ) from error
    for low, high in zip(robot.lower, robot.upper, strict=True):
        if not low < high:
            raise DataError(
                "a joint's min_deg is not below its max_deg.", do="Correct the limits.", file=path
            )
    return robot


def parse_load(entry: Mapping[str, Any], joints: int, path: Path | str) -> Load:
    """One `[[loads]]` entry of a robot file or a data set. Raises DataError when it is not physical."""
    try:
        load = Load(int(entry["link"]), float(entry["mass_kg"]), tuple(float(x) for x in entry["cog_mm"]))  # type: ignore[arg-type]
    except KeyError as error:
        raise DataError(
            "a load lacks this key.", do="Give link, mass_kg, cog_mm.", file=path, key=error.args[0]
        ) from error
    if not 1 <= load.link <= joints or len(load.cog_mm) != 3:
        raise DataError(
            f"a load names link {load.link} with {len(load.cog_mm)} coordinates.",
            do=f"Use a link from 1 to {joints} and three coordinates in mm.",
            file=path,
            key="loads",
        )
    if not (load.mass_kg > 0.0 and all(math.isfinite(x) for x in (load.mass_kg, *load.cog_mm))):
        raise DataError(
            f"a load of {load.mass_kg} kg cannot be.",
            do="Give its mass in kg, above zero.",
            file=path,
            key="loads",
        )
    return load
