"""Data set (`NAME.csv`, `NAME.toml`) of the reference, with parameters, residuals, weights.

Numbers become decimals from their text, without rounding. A reading is a list of rows: the point (3), the orientation
as log(R_measured R') in the world (3), the distance to a base target (1), each if it was measured.
"""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from tests.reference.chain import gravity_torques, target_frame
from tests.reference.decimals import Matrix, degrees, norm, precise, rotation_of_quaternion, rotation_vector
from tests.reference.robots import ARMS, Arm

ZERO = Decimal(0)
UNITS = {"alpha": "deg", "theta": "deg", "beta": "deg", "c": "1e-6 rad/(N.mm)"}


@dataclass(frozen=True)
class Parameter:
    """Parameter to be identified, with its unit and the slot on which it acts.

    It acts on readings that match `series` and `target`.
    """

    name: str
    slot: str
    unit: str
    series: str = ""
    target: str = ""


@dataclass(frozen=True)
class Reading:
    """Row of the file.

    `angles` are model angles, rad; quantities that were not measured are None.
    """

    name: str
    series: str
    target: str
    angles: tuple[Decimal, ...]
    torques: tuple[Decimal, ...]
    point: Matrix | None
    rotation: Matrix | None
    length: Decimal | None
    base_target: str
    uncertainty: Mapping[str, Decimal]


@dataclass(frozen=True)
class Problem:
    """Measured and declared data of a problem; vectors in mm, `noise` as in the header."""

    arm: Arm
    readings: tuple[Reading, ...]
    parameters: tuple[Parameter, ...]
    targets: Mapping[str, Mapping[str, Matrix]]  # series -> target -> (3,)
    base_targets: Mapping[str, Matrix]
    noise: Mapping[str, Any]


@precise
def read_problem(path: Path) -> Problem:
    """Read the data set of `path` (the CSV).

    Its parameters are those of the header's groups less those that the header holds as redundant.
    """
    header = tomllib.loads(path.with_suffix(".toml").read_text("utf-8"), parse_float=Decimal)
    arm = ARMS[header["robot"]]
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    readings = tuple(_reading(row, arm, header) for row in rows)
    common = header.get("tool_targets", {})
    own = header.get("series", {})
    targets = {
        name: {t: vector(v) for t, v in {**common, **own.get(name, {}).get("tool_targets", {})}.items()}
        for name in sorted({reading.series for reading in readings})
    }
    base_targets = {name: vector(v) for name, v in header.get("base_targets", {}).items()}
    parameters = _parameters(arm, header["model"]["fit"], readings)
    if "base_targets_u_mm" in header:
        parameters += [Parameter(f"{name}.{k}", f"{name}.{k}", "mm") for name in base_targets for k in "xyz"]
    held = header["model"].get("hold", [])
    kept = tuple(p for p in parameters if p.name not in held)
    if len(kept) != len(parameters) - len(held):
        raise ValueError(f"not all of {held} are parameters")
    return Problem(arm, readings, kept, targets, base_targets, header["noise"])


def vector(values: Sequence[Any]) -> Matrix:
    return np.array([Decimal(v) for v in values])


def _reading(row: Mapping[str, str], arm: Arm, header: Mapping[str, Any]) -> Reading:
    controller = [degrees(Decimal(row[f"j{k}_deg"])) for k in range(1, len(arm.links) + 1)]
    coupling = header.get("joint_coupling", "none")
    angles = controller
    if coupling != "none":
        angles = [
            sum((m * c for m, c in zip(line, controller, strict=True)), ZERO)
            for line in arm.couplings[coupling]
        ]
    loads = [(link, Decimal(mass), vector(cog)) for link, mass, cog in arm.loads]
    if "loads" in header:
        loads = [(load["link"], Decimal(load["mass_kg"]), vector(load["cog_mm"])) for load in header["loads"]]

    def numbers(*names: str) -> Matrix | None:
        cells = [row.get(name, "") for name in names]
        return vector(cells) if all(cells) else None

    length = numbers("length_mm")
    quaternion = numbers("rot_w", "rot_x", "rot_y", "rot_z")
    uncertain = ("u_x_mm", "u_y_mm", "u_z_mm", "u_length_mm", "u_rot_mrad")
    return Reading(
        name=row["reading_id"],
        series=row.get("series", "") or "main",
        target=row["tool_target"],
        angles=tuple(angles),
        torques=tuple(gravity_torques(arm, angles, loads)),
        point=numbers("x_mm", "y_mm", "z_mm"),
        rotation=None if quaternion is None else rotation_of_quaternion(quaternion),
        length=None if length is None else length[0],
        base_target=row.get("base_target", ""),
        uncertainty={name: Decimal(row[name]) for name in uncertain if row.get(name)},
    )


def _parameters(arm: Arm, groups: Sequence[str], readings: Sequence[Reading]) -> list[Parameter]:
    """The parameters of the groups of `[model] fit`, named as contracts and reports name them."""
    links = range(2, len(arm.links) + 1)
    series = sorted({reading.series for reading in readings})
    suffix = {name: f"[{name}]" if len(series) > 1 else "" for name in series}
    pose = ("x", "y", "z", "rx", "ry", "rz")
    out: list[Parameter] = []
    for group in groups:
        if group == "base":
            for s in series:
                out += [Parameter(f"base{suffix[s]}.{k}", f"base.{k}", _unit(k), s) for k in pose]
        elif group == "tool":
            for s in series:
                for t in sorted({r.target for r in readings if r.series == s}):
                    turns = any(r.rotation is not None for r in readings if (r.series, r.target) == (s, t))
                    names = pose if turns else pose[:3]
                    out += [Parameter(f"{t}{suffix[s]}.{k}", f"target.{k}", _unit(k), s, t) for k in names]
        elif group == "geometry":
            kinds = ("alpha", "a", "theta", "d")
            first = [] if arm.modified else [("alpha", 1), ("a", 1)]
            names = [f"{kind}{k}" for kind, k in [*first, *((kind, k) for k in links for kind in kinds)]]
            out += [Parameter(name, name, UNITS.get(name[:-1], "mm")) for name in names]
        elif group == "parallel_twist":
            out += [Parameter(f"beta{k}", f"beta{k}", "deg") for k in arm.parallel]
        elif group == "compliance":
            out += [Parameter(f"c{k}", f"theta{k}", UNITS["c"]) for k in links]
        else:
            raise ValueError(f"the reference does not know the group {group!r}")
    return out


def _unit(axis: str) -> str:
    return "deg" if axis.startswith("r") else "mm"


def slots(problem: Problem, reading: Reading, values: Mapping[str, Decimal]) -> dict[str, Decimal]:
    """Add up the parameters on every slot for one reading, rad and mm.

    The nominal targets are included.
    """
    nominal = problem.targets[reading.series][reading.target]
    add = {f"target.{axis}": nominal[k] for k, axis in enumerate("xyz")}
    if reading.base_target:
        anchor = problem.base_targets[reading.base_target]
        add |= {f"{reading.base_target}.{axis}": anchor[k] for k, axis in enumerate("xyz")}
    for p in problem.parameters:
        if p.series in ("", reading.series) and p.target in ("", reading.target):
            amount = values[p.name]
            if p.unit == "deg":
                amount = degrees(amount)
            elif p.unit == UNITS["c"]:
                amount = amount * Decimal("1e-6") * reading.torques[int(p.slot[-1]) - 1]
            add[p.slot] = add.get(p.slot, ZERO) + amount
    return add


def distance(reading: Reading, add: Mapping[str, Decimal], frame: Matrix) -> Decimal:
    """Compute the distance from the tool target to the base target, mm."""
    anchor = np.array([add[f"{reading.base_target}.{axis}"] for axis in "xyz"])
    return norm(frame[:3, 3] - anchor)


def residual(problem: Problem, reading: Reading, values: Mapping[str, Decimal]) -> Matrix:
    """Compute measured less predicted values, (k,): mm, rad, mm."""
    add = slots(problem, reading, values)
    frame = target_frame(problem.arm, reading.angles, add)
    out: list[Decimal] = []
    if reading.point is not None:
        out += list(reading.point - frame[:3, 3])
    if reading.rotation is not None:
        out += list(rotation_vector(reading.rotation @ frame[:3, :3].T))
    if reading.length is not None:
        out.append(reading.length - distance(reading, add, frame))
    return np.array(out)
