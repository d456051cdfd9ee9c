"""Benchmark of ballbar calibration: the gain by the metrology chain and by fitting the legs.

Every seed draws an LR Mate. Its three base cups are 0.3 mm away from the positions in the cell file, the tool balls
by their stated uncertainty. 61 configurations of the example's cell are measured leg by leg, and the sides of both
triangles by the bar (Nubiola, thesis, chapter 4). Six calibrations are compared:

    exact        legs, cups and balls of the tool where they really are: what no chain can better
    exact cups   legs, cups where they really are, balls stated with their uncertainty, and the sides of the tool
    chain        legs, stated positions with their uncertainty, and the measured sides
    no sides     the same without the sides
    poses        the chain, but poses solved from six legs and fitted as points
    single balls the same with every ball as a visit of its own: points that share nothing, as they usually are fitted

Positions are compared with the simulated arm, in a separate frame that is fitted to the predicted points, as with a
tracker. Two regions are judged: within 200 mm of the point above the cups, and all front/up configurations that the
limits of the cell allow above the table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from acquisition import Cell, campaign_from, checked_plan
from acquisition.campaign import Visit
from acquisition.cell.workspace import is_allowed
from calib import identify, read_dataset
from calib.arm.start import align
from calib.convert import IMPORTERS
from calib.fit import base_model_of, place_nominal
from calib.model import ModelStructure
from calib.validation.judge import branches
from mocks.world import ArmState
from tests.benchmarks.clock import line
from tests.benchmarks.nests import Truth, example, header_of, legs_of, predicted_mm, sides_of, truth_of
from tests.calib.campaigns import write_files

CONFIGURATIONS = 61  # 46 front/up and 15 back/down in the thesis
NEAR_MM, FROM_CUPS_MM = 200.0, 300.0  # Figure 4.7
FRONT_UP_MM = 0.479  # mean of the thesis, Table 4.4, identified by the poses within the stroke
CHAIN = 1.1  # times the error with cups exactly known
_JUDGED = 400
Array = NDArray[np.float64]


@cache
def visits_of_example() -> tuple[Visit, ...]:
    """Plan the visits to 61 configurations of the example's cell, as its campaign would."""
    cell, _ = example()
    block = {"kind": "hexapod", "configurations": "all", "count": CONFIGURATIONS}
    campaign = campaign_from({"format": "truepose-campaign/1", "block": [block]}, "benchmark")
    return tuple(checked_plan(cell, campaign))


@cache
def judged_joints() -> dict[str, Array]:
    """Draw model angles (n, N), rad, in two regions.

    `front/up` covers the whole workspace, `near` the point above the cups.
    """
    cell, _ = example()
    rng = np.random.default_rng(0)
    low, high = np.array(cell.robot.limits_deg).T
    anywhere = rng.uniform(low, high, (40 * _JUDGED, len(low)))
    anywhere = cell.robot.model_angles(anywhere[is_allowed(cell, anywhere)])
    names = branches(cell.robot.model, anywhere)
    assert names is not None
    front_up = anywhere[[name.startswith("front/up") for name in names]][:_JUDGED]
    visits = visits_of_example()
    some = np.array([visits[i].joints_deg for i in rng.integers(0, len(visits), 40 * _JUDGED)])
    near = cell.robot.model_angles(some + rng.uniform(-30.0, 30.0, some.shape))
    cups = np.array(list(cell.nests.values()))
    middle = cups.mean(axis=0)
    above = middle + np.array([0.0, 0.0, np.sqrt(FROM_CUPS_MM**2 - np.sum((cups[0] - middle) ** 2))])
    nominal = ModelStructure(cell.robot.model, (), {"main": dict(cell.tool.targets)})
    off = np.linalg.norm(predicted_mm(nominal, np.zeros(0), near, cell) - above, axis=1)
    return {"front/up": front_up, "near": near[off < NEAR_MM][:_JUDGED]}


def errors_mm(model: ModelStructure, estimate: Array, truth: Truth, cell: Cell) -> dict[str, float]:
    """Mean position error of a model, mm, of each set of `judged_joints`."""
    out = {}
    for name, joints in judged_joints().items():
        predicted = predicted_mm(model, estimate, joints, cell)
        states = [ArmState(at, at, (1,) * len(at)) for at in map(tuple, np.degrees(joints).tolist())]
        there = np.array([truth.world.true_point(state, next(iter(cell.tool.targets))) for state in states])
        turn, shift = align(predicted, there, np.ones(len(there)))
        out[name] = float(np.mean(np.linalg.norm(predicted @ turn.T + shift - there, axis=1)))
    return out


def study(seed: int, folder: Path, visits: Sequence[Visit] | None = None) -> Mapping[str, dict[str, float]]:
    """Return mean position errors, mm, for each calibration of a seed.

    The nominal robot in its place is included.
    """
    cell, _ = example()
    truth = truth_of(cell, seed)
    blank = {"other_target": ""}
    legs = [row | blank for row in legs_of(truth, cell, visits_of_example() if visits is None else visits)]
    sides = sides_of(truth, cell, legs[0])
    u_mm = {"base_targets_u_mm": dict(cell.nests_u_mm), "tool_targets_u_mm": dict(cell.tool.stated_mm)}
    stated = header_of(cell, cell.nests, cell.tool.targets, **u_mm)
    chain = write_files(folder, [*sides, *legs], stated, "chain")
    poses = IMPORTERS["hexapod-legs"](chain)
    poses.write(folder / "poses.csv")
    apart = replace(poses, columns=poses.columns | {"visit": poses.columns["reading_id"]})
    apart.write(folder / "single_balls.csv")
    of_tool = [row for row in sides if row["tool_target"]]
    with_tool = header_of(cell, truth.cups, cell.tool.targets, tool_targets_u_mm=u_mm["tool_targets_u_mm"])
    files = {
        "exact": write_files(folder, legs, header_of(cell, truth.cups, truth.balls), "exact"),
        "exact cups": write_files(folder, [*of_tool, *legs], with_tool, "exact_cups"),
        "chain": chain,
        "no sides": write_files(folder, legs, stated, "no_sides"),
        "poses": folder / "poses.csv",
        "single balls": folder / "single_balls.csv",
    }
    nominal = read_dataset(chain)
    out = {"nominal": errors_mm(*place_nominal(nominal, base_model_of(nominal)), truth, cell)}
    for name, path in files.items():
        found = identify(read_dataset(path))
        out[name] = errors_mm(found.model, found.estimate, truth, cell)
    return out


def run(count: int = 20) -> bool:
    """Print the errors over `count` seeds next to their limits."""
    with TemporaryDirectory() as folder:
        found = [study(seed, Path(folder)) for seed in range(1, count + 1)]

    def figures(name: str, where: str) -> Array:
        return np.array([each[name][where] for each in found])

    reached = True
    for where in ("near", "front/up"):
        for name in found[0]:
            errors = figures(name, where)
            limit = {"near": 0.4, "front/up": FRONT_UP_MM}[where] if name == "chain" else None
            ok = limit is None or float(errors.max()) < limit
            what = f"{where}, {name}: mean error, mm, median (largest) of {count}"
            line(
                what, f"{np.median(errors):.4f} ({errors.max():.4f})", "" if limit is None else f"{limit}", ok
            )
            reached &= ok
        for name, wanted in (("exact cups", CHAIN), ("exact", None)):
            ratio = float(np.median(figures("chain", where) / figures(name, where)))
            ok = wanted is None or ratio < wanted
            line(f"{where}, chain / {name}", f"{ratio:.3f}", "" if wanted is None else f"{wanted}", ok)
            reached &= ok
        for name, wanted in (("single balls", count // 2 + 1), ("poses", None)):
            better = int(np.sum(figures("chain", where) < figures(name, where)))
            ok = wanted is None or better >= wanted
            line(
                f"{where}, legs better than {name}",
                f"{better} of {count}",
                "" if wanted is None else f"{wanted}",
                ok,
            )
            ratio = float(np.mean(figures("chain", where)) / np.mean(figures(name, where)))
            line(f"{where}, legs / {name}, mean errors", f"{ratio:.3f}", "1", ratio <= 1.0)
            reached &= ok and ratio <= 1.0
    return reached
