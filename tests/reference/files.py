"""Creation of the files of a certified problem: poses, true robot, readings, results.

Every draw comes from a seed through the standard library and is rounded, so that a problem can be made again
anywhere: poses to 0.001 deg, true values to four decimals, noise to six. Measured values have all the digits of a
double.
"""

from __future__ import annotations

import csv
import json
import random
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import tomli_w

from tests.reference.adjustment import Certified, adjust
from tests.reference.chain import target_frame
from tests.reference.decimals import Matrix, norm, precise, turn
from tests.reference.problem import Parameter, Problem, Reading, distance, read_problem, slots
from tests.reference.problems import PLANS, Plan
from tests.reference.weights import whitener

FOLDER = Path(__file__).parent.parent / "certified"
FORMAT = "truepose-certified/1"
# How far off the true robot is, at most; at least half of it, so that digits can be counted.
SIZES = {"deg": 0.2, "mm": 1.0, "1e-6 rad/(N.mm)": 0.6}
OF_BASE = {"deg": 2.0, "mm": 10.0}

Row = dict[str, str]


def make(name: str, folder: Path = FOLDER) -> Certified:
    """Write the data of a problem into `folder`, solve it, and write the result there as well."""
    problem, truth = write_data(name, folder)
    certified = adjust(problem, truth)
    _write_certified(PLANS[name], problem, truth, certified, folder / f"{name}.json")
    return certified


def write_data(name: str, folder: Path) -> tuple[Problem, dict[str, Decimal]]:
    """Write NAME.csv and NAME.toml; return the problem as read back, and the true parameters."""
    plan, dice = PLANS[name], random.Random(PLANS[name].seed)
    path = folder / f"{name}.csv"
    path.with_suffix(".toml").write_text(f"# {plan.title}\n{tomli_w.dumps(plan.header)}", encoding="utf-8")
    rows = _poses(plan, dice)
    _write(path, rows)
    unmeasured = read_problem(path)
    truth = {p.name: _off(p, dice) for p in unmeasured.parameters}
    for row, reading in zip(rows, unmeasured.readings, strict=True):
        row |= _measured(plan, unmeasured, reading, truth, dice)
    _write(path, rows)
    return read_problem(path), truth


def _write(path: Path, rows: Sequence[Row]) -> None:
    """A CSV with the columns that any row fills."""
    columns = [name for name in rows[0] if any(row[name] for row in rows)]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _write_certified(
    plan: Plan, problem: Problem, truth: Mapping[str, Decimal], certified: Certified, path: Path
) -> None:
    table = {
        "format": FORMAT,
        "title": plan.title,
        "sum_of_squares": f"{certified.sum_of_squares:.19e}",
        "degrees_of_freedom": certified.degrees_of_freedom,
        "condition": float(f"{certified.condition:.3g}"),
    }
    rows = {
        p.name: {
            "unit": p.unit,
            "truth": str(truth[p.name]),
            "estimate": f"{certified.estimate[p.name]:.19e}",
            "standard_error": f"{certified.standard_error[p.name]:.19e}",
        }
        for p in problem.parameters
    }
    parameters = ",\n".join(f"  {json.dumps(name)}: {json.dumps(row)}" for name, row in rows.items())
    text = json.dumps(table, indent=1)[:-2] + f',\n "parameters": {{\n{parameters}\n }}\n}}\n'
    path.write_text(text, encoding="utf-8")


def _off(p: Parameter, dice: random.Random) -> Decimal:
    """Draw a true value between half and the whole of the scale, of either sign.

    Compliances are positive.
    """
    most = (OF_BASE if p.name.startswith("base") else SIZES)[p.unit]
    sign = 1.0 if p.unit.startswith("1e-6") else (1.0 if dice.random() < 0.5 else -1.0)
    return Decimal(f"{sign * dice.uniform(0.5, 1.0) * most:.4f}")


def _poses(plan: Plan, dice: random.Random) -> list[Row]:
    """Rows without what is measured. Targets take turns; the ranges are those of the model's angles."""
    rows = []
    for series, (kind, count) in plan.series.items():
        targets = sorted(plan.own.get(series, {}).get("tool_targets", plan.targets))
        for i in range(count):
            angles = [dice.uniform(*limit) for limit in plan.limits]
            if plan.coupling != "none":
                angles[2] = -angles[2] - angles[1]
            row = {"reading_id": str(len(rows) + 1), "series": series}
            row |= {f"j{k}_deg": f"{angle:.3f}" for k, angle in enumerate(angles, start=1)}
            row["tool_target"] = targets[i % len(targets)]
            row |= dict.fromkeys(("x_mm", "y_mm", "z_mm"), "")
            row |= dict.fromkeys(("rot_w", "rot_x", "rot_y", "rot_z"), "1" if kind == "pose" else "")
            row |= {"base_target": "", "length_mm": ""}
            if kind == "length":
                row["base_target"] = sorted(plan.bases)[i // len(targets) % len(plan.bases)]
            row |= dict.fromkeys((column for own in plan.by_row.values() for column in own), "")
            row |= {
                column: f"{dice.uniform(*span):.4f}" for column, span in plan.by_row.get(kind, {}).items()
            }
            rows.append(row)
    return rows


@precise
def _measured(
    plan: Plan, problem: Problem, reading: Reading, truth: Mapping[str, Decimal], dice: random.Random
) -> Row:
    """Simulate a reading of the true robot.

    The noise is drawn from the declared covariance of the reading.
    """
    kind = plan.series[reading.series][0]
    add = slots(problem, reading, truth)
    frame = target_frame(problem.arm, reading.angles, add)
    exact = replace(
        reading,
        point=None if kind == "length" else frame[:3, 3],
        rotation=frame[:3, :3] if kind == "pose" else None,
        length=distance(reading, add, frame) if kind == "length" else None,
    )
    lower = whitener(problem, exact)
    drawn = np.array([Decimal(f"{dice.gauss(0.0, 1.0) if plan.noisy else 0.0:.6f}") for _ in lower])
    noise = list(lower @ drawn)
    row: Row = {}
    if exact.point is not None:
        row |= {f"{axis}_mm": _text(exact.point[k] + noise[k]) for k, axis in enumerate("xyz")}
    if exact.rotation is not None:
        turned = exact.rotation
        for axis in range(3):
            turned = turn(axis, noise[3 + axis])[:3, :3] @ turned
        row |= {f"rot_{q}": _text(v) for q, v in zip("wxyz", _quaternion(turned), strict=True)}
    if exact.length is not None:
        row["length_mm"] = _text(exact.length + noise[-1])
    return row


def _text(value: Decimal) -> str:
    return repr(float(value))


def _quaternion(rotation: Matrix) -> Matrix:
    """Compute the quaternion (4,) of a rotation, scalar first.

    It is the longest row of the matrix 4 q q', which is the best conditioned.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation
    rows = np.array(
        [
            [1 + a + e + i, h - f, c - g, d - b],
            [h - f, 1 + a - e - i, b + d, c + g],
            [c - g, b + d, 1 - a + e - i, f + h],
            [d - b, c + g, f + h, 1 - a - e + i],
        ]
    )
    longest = max(rows, key=norm)
    return longest / norm(longest)
