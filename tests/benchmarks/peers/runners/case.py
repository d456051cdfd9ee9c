"""Input and output of a runner. It runs in the interpreter of every package: only numpy.

`python run_NAME.py ANSWER.json CASE.npz ...`: a case holds the readings and the nominal arm. Joint angles are those
of the modified DH convention (the nominal theta is added already), so that a joint at zero needs no offset. A
solver prepares the data that a user would have in memory, is then timed, and returns a function that predicts
points from joint angles.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

Predict = Callable[[Any], Any]  # (n, 6) angles, rad -> (n, 3) points, mm
Prepare = Callable[["Case"], Callable[[], Predict]]

TRIES, BUDGET_S = 20, 5.0


@dataclass(frozen=True)
class Case:
    """Case for a runner: readings to identify from, angles to predict, and the nominal arm.

    `joints` (n, 6) is in rad, `measured` (n, 3) in mm.
    """

    name: str
    joints: Any
    measured: Any
    fresh_joints: Any
    alpha: Any
    a: Any
    d: Any
    target: Any
    lower: Any
    upper: Any

    @classmethod
    def read(cls, path: str) -> Case:
        """The case of a file."""
        with np.load(path) as file:
            return cls(Path(path).stem, **{name: file[name] for name in file.files})

    def write(self, path: Path) -> None:
        """Write the file of the case."""
        np.savez(path, **{name: value for name, value in vars(self).items() if name != "name"})

    def urdf(self) -> str:
        """The nominal arm as URDF, m; its links are base, link1 .. link6, tool."""
        parents = ["base", *(f"link{k}" for k in range(1, 7))]
        parts = ["<robot name='arm'>", *(f"<link name='{name}'/>" for name in (*parents, "tool"))]
        for k in range(6):
            alpha = self.alpha[k]
            y, z = -self.d[k] * np.sin(alpha), self.d[k] * np.cos(alpha)
            parts.append(
                f"<joint name='joint{k + 1}' type='revolute'><parent link='{parents[k]}'/>"
                f"<child link='link{k + 1}'/><axis xyz='0 0 1'/>"
                f"<origin xyz='{self.a[k] / 1e3:.17g} {y / 1e3:.17g} {z / 1e3:.17g}' rpy='{alpha:.17g} 0 0'/>"
                f"<limit lower='{self.lower[k]:.17g}' upper='{self.upper[k]:.17g}' effort='1' velocity='1'/></joint>"
            )
        x, y, z = self.target / 1e3
        parts.append(
            "<joint name='flange' type='fixed'><parent link='link6'/><child link='tool'/>"
            f"<origin xyz='{x:.17g} {y:.17g} {z:.17g}' rpy='0 0 0'/></joint></robot>"
        )
        return "\n".join(parts)


def timed(prepare: Callable[[], Callable[[], Any]]) -> tuple[float, Any]:
    """Least processor time of what `prepare` returns, and what that returned.

    One try to warm up; then up to TRIES tries, but none begins after BUDGET_S.
    """
    least, spent, answer = float("inf"), 0.0, None
    for attempt in range(TRIES + 1):
        solve = prepare()
        begin = time.process_time()
        answer = solve()
        took = time.process_time() - begin
        spent += took
        if attempt > 0 or spent > BUDGET_S:
            least = min(least, took)
        if spent > BUDGET_S:
            break
    return least, answer


def answer_cases(solvers: Mapping[str, Prepare], packages: tuple[str, ...]) -> None:
    """Solve every case on the command line by every solver, and write the answer file."""
    answers = []
    for path in sys.argv[2:]:
        case = Case.read(path)
        for solver, prepare in solvers.items():
            seconds, predict = timed(lambda: prepare(case))  # noqa: B023 - called before the loop goes on
            points = np.asarray(predict(case.fresh_joints)).tolist()
            answers.append({"case": case.name, "solver": solver, "seconds": seconds, "points": points})
    write({"versions": {name: version(name) for name in packages}, "answers": answers})


def write(document: Mapping[str, Any]) -> None:
    """Write the answer file."""
    Path(sys.argv[1]).write_text(json.dumps(document), encoding="utf-8")
