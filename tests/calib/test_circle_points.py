"""Test axes from circles.

These would catch: an axis that points the wrong way, a base on the wrong side of d_1, and a tool in another frame.
They would also catch sweeps that are missed or made up, gross errors that bend an axis, and a useless start.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib import Dataset, identify, load_robot
from calib.errors import DataError
from calib.fit import placing
from calib.fit.circle_points import find_sweeps, fit_axes, starts
from tests.benchmarks.arm import tool_frames
from tests.calib.cells import ALL, NOISE, POSE, Cell
from tests.calib.test_kinds_of_reading import miss

Array = NDArray[np.float64]

HOME = np.radians([10.0, 20.0, -10.0, 5.0, 30.0, 0.0])
RANGES = {1: (-60.0, 60.0), 2: (-30.0, 40.0), 5: (-70.0, 70.0), 6: (-150.0, 150.0)}


def sweeps(ranges: dict[int, tuple[float, float]], count: int = 7, home: Array = HOME) -> Array:
    """Sweep one joint after the other, from low to high; return (n, 6) joint angles, rad."""
    out = []
    for joint, (low, high) in ranges.items():
        part = np.tile(home, (count, 1))
        part[:, joint - 1] = np.radians(np.linspace(low, high, count))
        out.append(part)
    return np.vstack(out)


class TestAxes:
    def circles(self, noise: float, seed: int = 1) -> tuple[Array, Array, Array, Array, Array]:
        """Points (S, n, 3) and angles (S, n) of forty circles, with radius, direction and centre."""
        rng = np.random.default_rng(seed)
        turns = Rotation.random(40, rng=rng).as_matrix()
        radius = rng.uniform(50.0, 800.0, 40)
        centre = rng.uniform(-1000.0, 1000.0, (40, 3))
        angles = rng.uniform(-1.0, 1.0, (40, 1)) + np.linspace(0.0, 1.2, 15)
        flat = radius[:, None, None] * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
        points = np.einsum("sij,snj->sni", turns, flat) + centre[:, None]
        return points + rng.normal(0.0, noise, points.shape), angles, radius, turns[:, :, 2], centre

    def test_without_noise(self) -> None:
        points, angles, radius, direction, centre = self.circles(0.0)
        found = fit_axes(points, angles, np.ones(angles.shape, dtype=bool))
        np.testing.assert_allclose(found.direction, direction, rtol=0, atol=1e-10)
        np.testing.assert_allclose(found.centre, centre, rtol=0, atol=1e-7)
        np.testing.assert_allclose(np.linalg.norm(found.cosine, axis=1), radius, rtol=1e-10)
        there = found.centre + np.cos(0.3) * found.cosine + np.sin(0.3) * found.sine
        turns = [Rotation.from_rotvec(0.3 * z - a * z) for z, a in zip(direction, angles[:, 0], strict=True)]
        expected = [c + r.apply(p - c) for c, r, p in zip(centre, turns, points[:, 0], strict=True)]
        np.testing.assert_allclose(there, expected, rtol=0, atol=1e-7)

    def test_the_uncertainty_of_the_direction(self) -> None:
        """The angle between found and true axis of 700 circles agrees with its uncertainty.

        The uncertainty is the standard one of two components.
        """
        ratios = []
        for seed in range(18):
            points, angles, _, direction, _ = self.circles(0.05, seed)
            found = fit_axes(points, angles, np.ones(angles.shape, dtype=bool))
            off = np.linalg.norm(np.cross(found.direction, direction), axis=1)
            ratios.append(off / found.tilt)
        assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.1)

    def test_gross_errors_and_sweeps_of_different_length(self) -> None:
        points, angles, _, direction, _ = self.circles(0.0)
        plain = fit_axes(points[:, :12], angles[:, :12], np.ones((40, 12), dtype=bool))
        measured = np.ones(angles.shape, dtype=bool)
        measured[:, 12:] = False
        points[:, 12:] = 1e4  # padding may hold anything
        padded = fit_axes(points, angles, measured)
        np.testing.assert_allclose(padded.direction, plain.direction, rtol=0, atol=1e-12)
        points[:, 4] += [20.0, -30.0, 25.0]
        spoilt = fit_axes(points, angles, measured)
        off = np.linalg.norm(np.cross(spoilt.direction, direction), axis=1)
        unweighted = np.linalg.norm(
            np.cross(_plain_direction(points[:, :12], angles[:, :12]), direction), axis=1
        )
        assert np.median(off) < 0.2 * np.median(unweighted)


def _plain_direction(points: Array, angles: Array) -> Array:
    """Directions by least squares without weights, one circle at a time."""
    out = []
    for p, a in zip(points, angles, strict=True):
        found = np.linalg.lstsq(np.column_stack([np.ones_like(a), np.cos(a), np.sin(a)]), p, rcond=None)[0]
        z = np.cross(found[1], found[2])
        out.append(z / np.linalg.norm(z))
    return np.array(out)


class TestFinding:
    def cell(self) -> Cell:
        cell = Cell()
        cell.measure("p", 30)
        cell.measure("p", 28, ["T2"], joints=sweeps(RANGES), validation=0)
        for i, row in enumerate(cell.rows):
            row["reading_id"] = str(i)
        return cell

    def test_sweeps_among_other_readings_in_any_order(self, tmp_path: Path) -> None:
        cell = self.cell()
        found = find_sweeps(cell.dataset(tmp_path / "1"))
        assert [(s.joint, len(s.rows)) for s in found] == [(1, 8), (2, 8), (5, 8), (6, 7)], (
            "the middle of the last sweep is a reading of the others too"
        )
        ids = [{cell.rows[i]["reading_id"] for i in s.rows} for s in found]
        cell.rows = [cell.rows[i] for i in np.random.default_rng(1).permutation(len(cell.rows))]
        again = find_sweeps(cell.dataset(tmp_path / "2"))
        assert [{cell.rows[i]["reading_id"] for i in s.rows} for s in again] == ids

    @pytest.mark.parametrize(
        ("count", "ranges", "found"),
        [
            (6, {3: (-15.1, 15.1)}, 1),
            (5, {3: (-40.0, 40.0)}, 0),
            (9, {3: (-12.0, 12.0)}, 0),
        ],
    )
    def test_six_readings_over_thirty_degrees(
        self, count: int, ranges: dict[int, tuple[float, float]], found: int, tmp_path: Path
    ) -> None:
        cell = Cell()
        cell.measure("p", count, ["T2"], joints=sweeps(ranges, count), validation=0)
        assert len(find_sweeps(cell.dataset(tmp_path))) == found

    def test_what_is_no_sweep(self, tmp_path: Path) -> None:
        """Two targets, two series, validation rows, rejected rows, a second joint that moves along."""
        for spoil in ("target", "series", "validation", "rejected", "joint"):
            cell = Cell()
            cell.measure("p", 8, ["T2"], joints=sweeps({3: (-40.0, 40.0)}, 8), validation=0)
            cell.measure("p", 10)
            for i, row in enumerate(cell.rows):
                row["reading_id"], row["status"] = str(i), "ok"
            for row in cell.rows[1:8:2]:
                row |= {
                    "target": {"tool_target": "T3"},
                    "series": {"series": "night"},
                    "validation": {"set": "validation"},
                    "rejected": {"status": "rejected:fog"},
                    "joint": {"j5_deg": row["j5_deg"] + 0.5},
                }[spoil]
            assert find_sweeps(cell.dataset(tmp_path / spoil)) == (), spoil


def swept(name: str, tmp_path: Path, add: dict[str, float]) -> tuple[Dataset, Array]:
    """Simulate sweeps of a robot with slots `add` and an arbitrary tool, anywhere in the world.

    Return the data set and the tool.
    """
    robot = load_robot(name)
    cell = Cell(place=POSE)
    joints = sweeps(RANGES)
    cell.measure("p", len(joints), ["T1"], joints=joints, validation=0)
    tool = np.array([80.0, -45.0, 210.0])
    frames = POSE @ tool_frames(robot, joints, add, np.tile(tool, (len(joints), 1)))
    for row, frame in zip(cell.rows, frames, strict=True):
        row |= zip(("x_mm", "y_mm", "z_mm"), map(float, frame[:3, 3]), strict=True)
    return cell.dataset(tmp_path, robot=name, model={"fit": [*ALL, "tool"]}), tool


class TestStart:
    @pytest.mark.parametrize("name", ["abb-irb120", "fanuc-lrmate200ic", "ur10"])
    @pytest.mark.parametrize(
        "add",
        [
            {},
            {
                "theta3": 0.4,
                "a3": 60.0,
                "alpha4": 0.2,
                "d4": -40.0,
            },  # nothing of it stands between axes 1, 2 or 5, 6
        ],
    )
    def test_base_and_tool_are_exact_whatever_stands_between(
        self, name: str, add: dict[str, float], tmp_path: Path
    ) -> None:
        if name == "ur10" and add:
            add = {"theta3": 0.4, "a3": 60.0, "alpha3": 0.2, "d3": -40.0}
        data, tool = swept(name, tmp_path, add)
        start = starts(data)[0]
        assert start.base is not None
        np.testing.assert_allclose(start.base, POSE, rtol=0, atol=1e-8)
        np.testing.assert_allclose(start.targets[0], tool, rtol=0, atol=1e-7)

    def test_a_target_on_the_axis_tells_no_tool(self, tmp_path: Path) -> None:
        cell = Cell(place=POSE)
        joints = sweeps(RANGES)
        cell.measure("p", len(joints), ["T1"], joints=joints, noise=NOISE, validation=0)
        start = starts(cell.dataset(tmp_path))[0]
        assert start.base is not None
        assert start.targets == {}

    def test_without_sweeps_there_is_none(self, tmp_path: Path) -> None:
        cell = Cell()
        cell.measure("p", 40)
        assert starts(cell.dataset(tmp_path)) == {}


def long_tool(seed: int, folder: Path) -> tuple[Cell, Dataset]:
    """Simulate twelve poses and four sweeps of an arm of 580 mm.

    Its tool is metres away from its place in the header.
    """
    cell = Cell(seed, place=POSE)
    cell.targets["T1"] = cell.targets["T1"] + np.random.default_rng(seed).normal(0.0, 1700.0, 3)
    joints = sweeps(RANGES, 6)
    cell.measure("p", len(joints), ["T1"], joints=joints, validation=0)
    cell.measure("p", 12, ["T1"])
    for i, row in enumerate(cell.rows):
        row["reading_id"] = str(i)
    return cell, cell.dataset(folder, model={"fit": [*ALL, "tool"]})


def test_a_long_unknown_tool_is_found_from_circles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the circles, the robots of 24 cells are found.

    Without them, alignment and averaging lose at least one.
    """
    lost = {True: 0, False: 0}
    cells = [long_tool(seed, tmp_path / str(seed)) for seed in range(24)]
    for circles in (True, False):
        if not circles:
            monkeypatch.setattr(placing, "starts", lambda _: {})
        for cell, data in cells:
            try:
                result = identify(data)
            except DataError:  # ended so far off that the arm is taken for another
                lost[circles] += 1
            else:
                lost[circles] += not (result.converged and miss(cell, data, result).max() < 1e-3)
    assert lost[True] == 0
    assert lost[False] >= 1


@pytest.mark.parametrize("swept_too", [True, False])
def test_zeros_that_are_off_by_tens_of_degrees(swept_too: bool, tmp_path: Path) -> None:
    """The misfit of a far start is no noise and does not increase the weight of the priors.

    Otherwise the priors would hold the zeros.
    """
    cell = Cell(place=POSE)
    for joint, degrees in ((2, 25.0), (3, -30.0), (4, 20.0), (5, -35.0), (6, 30.0)):
        cell.add[f"theta{joint}"] = np.radians(degrees)
    if swept_too:
        joints = sweeps(RANGES)
        cell.measure("p", len(joints), ["T2"], joints=joints, validation=0)
    cell.measure("p", 30)
    for i, row in enumerate(cell.rows):
        row["reading_id"] = str(i)
    data = cell.dataset(tmp_path)
    result = identify(data)
    assert result.converged
    assert miss(cell, data, result).max() < 1e-5


def test_sweeps_change_nothing_where_the_start_is_good(tmp_path: Path) -> None:
    cell = Cell(place=POSE)
    joints = sweeps(RANGES)
    cell.measure("p", len(joints), ["T2"], joints=joints, noise=NOISE, validation=0)
    cell.measure("p", 40, noise=NOISE)
    for i, row in enumerate(cell.rows):
        row["reading_id"] = str(i)
    data = cell.dataset(tmp_path)
    with_them = identify(data)
    assert starts(data)[0].base is not None
    assert 0.8 < with_them.noise_scale < 1.2
    assert np.sqrt(np.mean(miss(cell, data, with_them) ** 2)) < 0.05
