"""Benchmark of type priors: poses saved, and behaviour when the prior does not fit.

Arms are drawn about the mean of a type and measured by the second arm (`tests.benchmarks.arm`). Spreads of a
machined type are those between factory calibrations that makers give with their robots: 0.15 mm, 0.03 deg of a
twist, 0.1 deg of a joint zero; compliances 10 %. Each of 30 robots is identified with 60 poses, a prior is learned
through the files, and further robots are identified with fewer poses. Predicted U (k = 2) and true errors are
judged at held-out poses over the whole range of the joints.

There are three cells. In the first, an optical instrument sees one target while the arm moves through a third of
every range. The second is the same over the whole ranges. The third is a tracker with three targets over the whole
ranges, which needs no prior. Further cases are robots that share nothing, and robots that are no members: one
parameter is ten spreads off, or all of them are three spreads off.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from calib import Dataset, IdentificationFit, identify, save_model
from calib.array import Array
from calib.data import Noise
from calib.fit import base_model_of, expanded
from calib.fit.type_prior import TypePrior
from calib.prior import FEWEST, TypeMember, learn, load_prior, save_prior
from calib.units import to_internal
from mocks.world.robots import THESIS_COMPLIANCE
from tests.benchmarks.clock import line
from tests.benchmarks.coverage import GROUPS, RANGE, ROBOT, Kind, header_of, true_frames
from tests.calib.campaigns import conditions_of

ROBOTS, POSES, FRESH = 30, 60, 150
COUNTS = (12, 15, 18, 21, 24, 27, 30, 33, 36, 42, 48, 54, 60)
WANTED = 0.6
"""Share of the poses that the prior shall do with, in the first cell."""
_PRIORS = 3
# What 95 % become where the prior alone decides, whose variance is taken wider than it was found by one standard error
# of it and that of the mean: it shall not promise too much, and no less than this
_WIDEST = float(chi2.cdf(chi2.ppf(0.95, 3) * (1.0 + np.sqrt(2.0 / (ROBOTS - 1)) + 1.0 / ROBOTS), 3))
_SHARED_NOTHING, _HARM = 1.02, 1.05
_ALPHA, _ZERO, _LENGTH, _SOFT = 0.03, 0.1, 0.15, 0.10
_STILL = "d3"  # slides along the parallel axes as d2 does
_BASE = {"mm": 0.5, "deg": 0.02}


@dataclass(frozen=True)
class Cell:
    """Measurement conditions of a campaign.

    `sigma_mm` is the noise of one coordinate, `window` the share of every joint's range that is used.
    """

    name: str
    targets: tuple[str, ...]
    sigma_mm: float
    window: float


CELLS = (
    Cell("one target, 0.1 mm, a third of the ranges", ("T2",), 0.1, 1.0 / 3.0),
    Cell("one target, 0.1 mm, whole ranges", ("T2",), 0.1, 1.0),
    Cell("three targets, 0.03 mm, whole ranges", ("T1", "T2", "T3"), 0.03, 1.0),
)


@dataclass(frozen=True)
class Type:
    """Mean and spread of every parameter of a type, internal units."""

    mean: Mapping[str, float]
    spread: Mapping[str, float]

    def robot(self, rng: np.random.Generator, off: Mapping[str, float] | None = None) -> dict[str, float]:
        """Draw the true parameters of one robot of the type.

        `off` gives, for some parameters, how many spreads they are away from their draw.
        """
        return {
            name: 0.0
            if name == _STILL
            else mean + self.spread[name] * (rng.normal() + (off or {}).get(name, 0.0))
            for name, mean in self.mean.items()
        }


def data_of(cell: Cell, truth: Mapping[str, float], seed: int) -> tuple[Dataset, Array]:
    """Simulate a data set of a cell, and the true positions of its validation poses (f, 3).

    It has POSES calibration poses of every target and FRESH validation poses.
    """
    rng = np.random.default_rng([seed, 5])
    middle, half = RANGE.mean(axis=1), 0.5 * cell.window * np.ptp(RANGE, axis=1)
    joints = rng.uniform(middle - half, middle + half, (POSES, ROBOT.joints))
    several = len(cell.targets)
    joints = np.vstack(
        [np.repeat(joints, several, axis=0), rng.uniform(RANGE[:, 0], RANGE[:, 1], (FRESH, ROBOT.joints))]
    )
    n = len(joints)
    conditions = replace(
        conditions_of(ROBOT, joints, seed),
        series=np.zeros(n, dtype=np.int64),
        target=np.arange(n) % several,
        anchor=np.full(n, -1),
        series_names=("main",),
        target_names=cell.targets,
        anchor_names=(),
    )
    positions = true_frames(dict(truth), joints, cell.targets, conditions.target)[:, :3, 3]
    measured = positions + rng.normal(0.0, cell.sigma_mm, (n, 3))
    header = header_of(Kind(cell.name, POSES, groups=GROUPS, targets=cell.targets))
    nothing = np.full(n, np.nan)
    dataset = Dataset(
        path=Path("simulated.csv"),
        header=replace(header, noise=Noise("isotropic", sigma_mm=cell.sigma_mm)),
        reading_id=tuple(str(i) for i in range(n)),
        sets=np.where(np.arange(n) < POSES * several, "calibration", "validation"),
        status=np.full(n, "ok"),
        conditions=replace(conditions, point=measured),
        points=measured,
        orientation=np.full((n, 4), np.nan),
        lengths=nothing,
        u_point=np.full((n, 3), np.nan),
        u_rotation=nothing,
        u_length=nothing,
        sha256=str(seed),
    )
    return dataset, positions[dataset.validation_rows]


def first_poses(dataset: Dataset, count: int) -> Dataset:
    """The data set with the first `count` of its calibration poses."""
    several = len(dataset.conditions.target_names)
    unused = (np.arange(len(dataset)) >= count * several) & ~dataset.validation_rows
    return replace(dataset, status=np.where(unused, "missed", dataset.status))


def a_type(seed: int, times: float = 1.0) -> Type:
    """Draw a machined type; its spreads are `times` the usual ones.

    The means have the scale of the usual spreads; compliances are those of the thesis's robot.
    """
    rng = np.random.default_rng([seed, 1])
    dataset, _ = data_of(CELLS[0], {}, 0)
    sizes = {"alpha": _ALPHA, "beta": _ALPHA, "theta": _ZERO, "a": _LENGTH, "d": _LENGTH}
    mean, spread = dict[str, float](), dict[str, float]()
    for p in base_model_of(dataset).parameters:
        kind = p.name.rstrip("0123456789")
        if kind == "c":
            mean[p.name] = THESIS_COMPLIANCE[int(p.name[1:]) - 1]
            spread[p.name] = times * _SOFT * mean[p.name]
        else:
            of_type = times if kind in sizes else 1.0
            spread[p.name] = to_internal(of_type * sizes.get(kind, _BASE[p.unit]), p.unit)
            mean[p.name] = spread[p.name] * rng.normal() * (kind in sizes)
    return Type(mean, spread)


def nothing_shared() -> Type:
    """Robots that have the usual sizes of the program for errors, and nothing in common."""
    dataset, _ = data_of(CELLS[0], {}, 0)
    parameters = base_model_of(dataset).parameters
    return Type(
        {p.name: 0.0 for p in parameters},
        {p.name: to_internal(_BASE[p.unit] if p.size is None else p.size, p.unit) for p in parameters},
    )


def learnt(cell: Cell, kind: Type, seed: int, folder: Path, robots: int = ROBOTS) -> TypePrior:
    """Learn the prior of a type from `robots` of its members, through the files."""
    members = []
    for i in range(robots):
        robot = kind.robot(np.random.default_rng([seed, 2, i]))
        path = folder / f"{i}.json"
        save_model(path, identify(data_of(cell, robot, 1000 * seed + i)[0]))
        members.append(TypeMember.read(path))
    save_prior(folder / "prior.json", learn(members))
    return load_prior(folder / "prior.json")


@dataclass(frozen=True)
class Judged:
    """Quality of one fit.

    The values are the largest predicted U, the RMS of U / 2 and of the true error, mm, and the share of errors
    within the 95 % region.
    """

    u_mm: float
    predicted_mm: float
    true_mm: float
    covered: float

    @classmethod
    def of(cls, found: IdentificationFit, dataset: Dataset, positions: Array) -> Judged:
        """Judge a fit at the validation poses, whose true positions are known."""
        at, covariance = found.predict_with_covariance(dataset.conditions.take(dataset.validation_rows))
        miss = at - positions
        distance = np.sum(miss * np.linalg.solve(covariance, miss[:, :, None])[:, :, 0], axis=1)
        return cls(
            float(expanded(covariance).max()),
            float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean())),
            float(np.sqrt(np.mean(np.sum(miss**2, axis=1)))),
            float(np.mean(distance <= chi2.ppf(0.95, 3))),
        )


def rms(values: Sequence[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def saved(cell: Cell, count: int, *, times: float = 1.0, judged: bool = False) -> bool:
    """Print how many poses the prior saves in a cell, and how true the predictions are.

    `times` multiplies the spreads of the type.
    """
    kind = a_type(1, times)
    cell = cell if times == 1.0 else replace(cell, name=f"{cell.name}, {times:g} times the spread")
    with tempfile.TemporaryDirectory() as folder:
        prior = learnt(cell, kind, 1, Path(folder))
    without: list[Judged] = []
    beside: dict[int, list[Judged]] = {n: [] for n in COUNTS}
    named = 0
    for i in range(count):
        dataset, positions = data_of(cell, kind.robot(np.random.default_rng([9, i])), 500_000 + i)
        without.append(Judged.of(identify(dataset), dataset, positions))
        for n in COUNTS:
            found = identify(first_poses(dataset, n), prior=prior)
            beside[n].append(Judged.of(found, dataset, positions))
            named += found.beside is not None and bool(found.beside.outside or found.beside.left_out)
    of_all = float(np.mean([j.u_mm for j in without]))
    reached = next((n for n in COUNTS if np.mean([j.u_mm for j in beside[n]]) <= of_all), COUNTS[-1])
    for name, those in (
        (f"{POSES} poses without", without),
        *((f"{n} poses with it", beside[n]) for n in sorted({reached, 36, POSES})),
    ):
        line(
            f"prior of {ROBOTS} robots, {cell.name}: {name}",
            f"U {np.mean([j.u_mm for j in those]):.3f}, predicted {rms([j.predicted_mm for j in those]):.4f}, "
            f"true {rms([j.true_mm for j in those]):.4f} mm, 95 % covers {np.mean([j.covered for j in those]):.1%}",
            "",
            True,
        )
    share = reached / POSES
    good = not judged or share <= WANTED
    line(
        f"poses with the prior for the same U, {cell.name}",
        f"{reached} of {POSES}",
        f"<= {WANTED:.0%}" if judged else "said",
        good,
    )
    at = beside[reached]
    true = rms([j.true_mm for j in at]) / rms([j.true_mm for j in without])
    kept = not judged or true <= 1.05
    line(
        f"true error there, over that of {POSES} without",
        f"{true:.3f} x",
        "<= 1.05" if judged else "said",
        kept,
    )
    covers = float(np.mean([j.covered for n in COUNTS for j in beside[n]]))
    sure = 0.93 <= covers <= _WIDEST
    line("95 % covers the truth, all numbers of poses", f"{covers:.1%}", f"93-{_WIDEST:.1%}", sure)
    calls = named / (count * len(COUNTS))
    line("fits of members called outside their type", f"{calls:.1%}", "<= 3 %", calls <= 0.03)
    return good and kept and sure and calls <= 0.03


def compared(name: str, kind: Type, off: Sequence[Mapping[str, float]], limit: float, count: int) -> bool:
    """Print the true error with the prior over that without it, for robots that do not fit it."""
    cell = CELLS[0]
    with tempfile.TemporaryDirectory() as folder:
        prior = learnt(cell, kind, 2, Path(folder))
    good = True
    for poses in (36, POSES):
        plain, beside, named = [], [], 0
        for i in range(count):
            robot = kind.robot(np.random.default_rng([8, i]), off[i % len(off)])
            dataset, positions = data_of(cell, robot, 700_000 + i)
            few = first_poses(dataset, poses)
            plain.append(Judged.of(identify(few), dataset, positions))
            found = identify(few, prior=prior)
            beside.append(Judged.of(found, dataset, positions))
            named += found.beside is not None and bool(found.beside.outside or found.beside.left_out)
        ratio = rms([j.true_mm for j in beside]) / rms([j.true_mm for j in plain])
        covers = float(np.mean([j.covered for j in beside]))
        line(
            f"{name}, {poses} poses: true error with over without",
            f"{ratio:.3f} x, called outside {named} of {count}, 95 % covers {covers:.1%}",
            f"<= {limit:g}",
            ratio <= limit,
        )
        good &= ratio <= limit
    return good


def strangers(robots: int, count: int) -> bool:
    """Print how many members a prior of few robots rejects as robots of another type."""
    kind, cell, left = a_type(1), CELLS[2], 0
    for seed in range(10, 10 + _PRIORS):
        with tempfile.TemporaryDirectory() as folder:
            prior = learnt(cell, kind, seed, Path(folder), robots)
        for i in range(count):
            dataset, _ = data_of(cell, kind.robot(np.random.default_rng([7, seed, i])), 900_000 + i)
            found = identify(first_poses(dataset, 36), prior=prior)
            left += found.beside is not None and found.beside.left_out
    said = f"{left} of {_PRIORS * count}"
    line(f"members that {_PRIORS} priors of {robots} robots take for strangers", said, "said", True)
    return True


def run(count: int = 20) -> bool:
    """Print the poses saved in every cell, and the results for priors that do not fit.

    A prior does not fit if the robots share nothing or if one of them is no member.
    """
    good = True
    for k, cell in enumerate(CELLS):
        good &= saved(cell, count, judged=k == 0)
    for times in (0.5, 2.0):
        good &= saved(CELLS[0], count, times=times)
    for robots in (FEWEST, 12):
        good &= strangers(robots, count)
    good &= compared("robots that share nothing", nothing_shared(), ({},), _SHARED_NOTHING, count)
    kind = a_type(1)
    names = [name for name in kind.mean if "." not in name and name != _STILL]
    alone = [{name: 10.0 * (-1.0) ** k} for k, name in enumerate(names)]
    half = [{name: 0.5 * by for name, by in each.items()} for each in alone]
    good &= compared("one parameter five spreads off", kind, half, _HARM, max(count, len(names)))
    good &= compared("one parameter ten spreads off", kind, alone, _HARM, max(count, len(names)))
    rng = np.random.default_rng(4)
    whole = [dict(zip(names, 3.0 * rng.choice((-1.0, 1.0), len(names)), strict=True)) for _ in range(count)]
    return compared("all parameters three spreads off", kind, whole, _HARM, count) and good
