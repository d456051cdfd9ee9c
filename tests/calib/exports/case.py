"""Measurements as users export them: one true campaign in about forty forms.

Each form states its expected result. The numbers are of a simulated robot with random errors, so that the result
can be compared with the truth. The forms follow the descriptions of the programs' exports and spreadsheets sent by
mail; none is a maker's own file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from calib import forward, load_robot
from calib.array import Array
from calib.units import DEG

N = 24
ROBOT = "abb-irb120"
TARGETS = np.array([[30.0, 0.0, 120.0], [-40.0, 25.0, 110.0], [0.0, -50.0, 140.0]])
LEFT_OUT = 5  # a row that some files mark as not measured


@dataclass(frozen=True)
class Truth:
    """True joints (n, 6) deg, points (n, 3 targets, 3) mm and turns (n, 4), scalar first."""

    joints: Array
    points: Array
    turns: Array


def truth() -> Truth:
    """Simulate the campaign, rounded to the digits of the files.

    The robot is placed, the tool is turned, and errors of 0.3 mm are in no model.
    """
    rng = np.random.default_rng(21)
    robot = load_robot(ROBOT)
    lower, upper = np.array(robot.lower) / DEG, np.array(robot.upper) / DEG
    joints = np.round(rng.uniform(0.6 * lower, 0.6 * upper, (N, 6)), 3)
    joints[0] = (100.125, 40.5, -30.25, 120.75, 60.5, 170.875)
    flange = forward(robot, joints * DEG)
    turn = Rotation.from_rotvec([0.3, -0.5, 1.1])
    local = flange[:, None, :3, 3] + np.einsum("nij,tj->nti", flange[:, :3, :3], TARGETS)
    points = local @ turn.as_matrix().T + (2500.0, -1200.0, 300.0) + rng.normal(0.0, 0.3, local.shape)
    measured = turn * Rotation.from_matrix(flange[:, :3, :3]) * Rotation.from_rotvec([0.2, 0.1, -0.4])
    measured = Rotation.from_rotvec(rng.normal(0.0, 5e-4, (N, 3))) * measured
    return Truth(joints, np.round(points, 4), measured.as_quat(scalar_first=True))


TRUTH = truth()
OWN = forward(load_robot(ROBOT), TRUTH.joints * DEG)[:, :3, 3]  # what the controller shows


@dataclass(frozen=True)
class Case:
    """Export with its expected questions and result.

    Attributes
    ----------
    write
        Writes the files.
    answers
        Answers of the user in addition to the robot.
    asks
        Keys of the questions that must be asked first.
    refuses
        Required text of the refusal, if the export must be refused.
    targets
        Targets of the truth that the files contain.
    within
        Tolerance of the points, mm.
    turned
        Whether there are orientations.
    lost, rejected
        Rows that are lost or rejected.
    lost_rows
        Rows that give no result.
    """

    name: str
    shape: str
    write: Callable[[Path], Sequence[Path]]
    answers: dict[str, str] = field(default_factory=dict)
    asks: tuple[str, ...] = ()
    refuses: str = ""
    targets: int = 1
    within: float = 1e-3
    turned: bool = False
    lost: tuple[int, ...] = ()
    lost_rows: tuple[int, ...] = ()
    rejected: tuple[int, ...] = ()


CASES: list[Case] = []


def case(shape: str, **expected: Any) -> Callable[[Callable[[Path], Any]], None]:
    def add(write: Callable[[Path], Any]) -> None:
        def files(folder: Path) -> Sequence[Path]:
            made = write(folder)
            return [made] if isinstance(made, Path) else made

        CASES.append(Case(write.__name__, shape, files, **expected))

    return add


def save(path: Path, lines: Sequence[str], encoding: str = "utf-8", end: str = "\n") -> Path:
    path.write_bytes((end.join(lines) + end).encode(encoding))
    return path


def num(value: float, decimals: int = 4, comma: bool = False, thousands: str = "") -> str:
    text = f"{value:,.{decimals}f}"
    marks = {",": thousands, ".": "," if comma else "."}
    return "".join(marks.get(c, c) for c in text)


def grid(*parts: ArrayLike, decimals: int = 6) -> list[list[str]]:
    return [
        [f"{value:.{decimals}f}" for value in row]
        for row in np.column_stack([np.asarray(part) for part in parts])
    ]


def named(names: Sequence[str], rows: Sequence[Sequence[str]], separator: str = ";") -> list[str]:
    return [separator.join(row) for row in (names, *rows)]


J, P, Q = TRUTH.joints, TRUTH.points[:, 0], TRUTH.turns
HEAD = [*(f"J{k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"]
BODY = [[*J[i].tolist(), *P[i].tolist()] for i in range(N)]
AXES = [f"A{k}" for k in range(1, 7)]


def angles(sequence: str) -> Array:
    return Rotation.from_quat(Q, scalar_first=True).as_euler(sequence, degrees=True)


def outcome(of: Case) -> str:
    """Describe the result of a case as in `docs/evidence/exports.md`."""
    if of.refuses and not of.asks:
        return "refused"
    asked = f"asked: {', '.join(f'`{key}`' for key in of.asks)}" if of.asks else ""
    return f"{asked}, then {'refused' if of.refuses else 'read'}" if asked else "read"
