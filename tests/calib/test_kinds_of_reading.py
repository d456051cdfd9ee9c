"""Test fits of every kind of reading.

These would catch: poses, lengths and mixtures that do not recover the measured robot, starts that fail in an
arbitrary world frame, a declared uncertainty that is not used, and parameters that are dropped wrongly.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib import Dataset, IdentificationFit, identify
from calib.arm.start import align
from calib.fit import readings_of
from calib.model import BoundModel, ModelStructure
from tests.benchmarks.coverage import ROBOT
from tests.calib.cells import ALL, NOISE, POSE, Cell
from tests.calib.chain import chain

Array = NDArray[np.float64]


def miss(cell: Cell, data: Dataset, result: IdentificationFit, *, aligned: bool = False) -> Array:
    """Return distances from the truth, (n,), mm.

    If `aligned`, a rigid motion is removed first; this is needed if the world frame is undetermined.
    """
    found, true = result.predict(data.conditions), np.array(cell.points)
    if aligned:
        rotation, translation = align(found, true, np.ones(len(true)))
        found = found @ rotation.T + translation
    return np.linalg.norm(found - true, axis=1)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def dropped(result: IdentificationFit) -> set[str]:
    return {drop.name for drop in result.dropped}


class TestPoses:
    def cell(self) -> Cell:
        """The tool hangs 36 mm and 40 deg from where the header has it, and the world lies anywhere."""
        cell = Cell(place=POSE)
        cell.targets["T1"] = np.array([30.0, -20.0, 125.0])
        cell.turn = Rotation.from_rotvec([0.5, -0.4, 0.3])
        return cell

    def test_without_noise(self, tmp_path: Path) -> None:
        cell = self.cell()
        cell.measure("po", 40, ["T1"])
        data = cell.dataset(tmp_path, model={"fit": [*ALL, "tool"]})
        result = identify(data)
        assert result.converged
        assert dropped(result) == {"d3", "theta6", "d6"}, (
            "the tool's frame shares turn and length with link 6"
        )
        assert miss(cell, data, result).max() < 1e-6
        found = BoundModel(result.model, data.conditions).frames(result.estimate).rotation
        off = Rotation.from_matrix(found) * Rotation.from_matrix(np.array(cell.turns)).inv()
        assert off.magnitude().max() < 1e-9

    def test_with_noise(self, tmp_path: Path) -> None:
        cell = self.cell()
        cell.measure("po", 60, ["T1"], noise=NOISE, validation=100)
        data = cell.dataset(tmp_path, model={"fit": [*ALL, "tool"]})
        result = identify(data)
        assert 0.85 < result.noise_scale < 1.15
        assert rms(miss(cell, data, result)) < 0.03
        assert result.degrees_of_freedom == 6 * 60 - (6 + 20 + 1 + 5 + 6 - 3)

    def test_orientations_tell_more_than_points_alone(self, tmp_path: Path) -> None:
        cell = Cell()
        cell.measure("po", 40, ["T2"], noise=NOISE)
        with_them = identify(cell.dataset(tmp_path / "1"))
        noise = {"kind": "isotropic", "sigma_mm": 0.03}
        without = identify(cell.dataset(tmp_path / "2", noise=noise))
        assert any("40" not in w and "60 orientations were not used" in w for w in without.warnings)
        both = (with_them.standard_errors > 0.0) & (without.standard_errors > 0.0)
        assert np.all(with_them.standard_errors[both] < without.standard_errors[both] * 1.001)
        assert without.degrees_of_freedom + 120 == with_them.degrees_of_freedom


class TestLengths:
    def test_known_base_targets_show_where_the_world_is(self, tmp_path: Path) -> None:
        cell = Cell(place=POSE)
        cell.measure("l", 160)
        data = cell.dataset(tmp_path)
        result = identify(data)
        assert result.converged
        assert dropped(result) == {"d3"}
        assert miss(cell, data, result).max() < 1e-6

    def test_known_base_targets_with_noise(self, tmp_path: Path) -> None:
        cell = Cell(place=POSE)
        cell.measure("l", 200, noise=NOISE, validation=100)
        data = cell.dataset(tmp_path)
        result = identify(data)
        assert 0.85 < result.noise_scale < 1.15
        points, covariance = result.predict_with_covariance(data.conditions)
        expected = float(np.sqrt(np.mean(np.trace(covariance, axis1=1, axis2=2))))
        assert rms(miss(cell, data, result)) < 2.0 * expected < 0.2
        assert points.shape == (300, 3)

    @pytest.mark.parametrize("given", ["free", {"B1": "free", "B2": "free", "B3": "free", "B4": "free"}])
    def test_unknown_base_targets(self, given: Any, tmp_path: Path) -> None:
        """Unknown base targets leave the world frame open, but the robot is recovered.

        Six numbers are dropped.
        """
        cell = Cell(place=POSE)
        cell.measure("l", 180)
        data = cell.dataset(tmp_path, base_targets=given)
        result = identify(data)
        assert result.converged
        gone = dropped(result)
        assert "d3" in gone
        assert len(gone) == 7
        assert all(name[0] == "B" for name in gone - {"d3"}), (
            "base targets give way, at the places first found"
        )
        assert miss(cell, data, result, aligned=True).max() < 1e-6

    def test_a_draw_wire_counts_from_an_unknown_zero(self, tmp_path: Path) -> None:
        cell = Cell(place=POSE)
        cell.zero = 337.5
        cell.measure("l", 180)
        data = cell.dataset(tmp_path / "1", model={"fit": [*ALL, "length_zero"]})
        result = identify(data)
        assert result.estimate[result.model.index["length_zero"]] == pytest.approx(337.5, abs=1e-6)
        assert miss(cell, data, result).max() < 1e-6
        plain = identify(cell.dataset(tmp_path / "2"))
        assert plain.noise_scale > 100.0, "without the zero nothing fits"

    def test_base_targets_known_within_an_uncertainty(self, tmp_path: Path) -> None:
        """Lengths correct the base targets relative to each other.

        Their common position is known from the declaration alone.
        """
        cell = Cell(place=POSE)
        declared = {b: (p + cell.rng.normal(0.0, 0.5, 3)).tolist() for b, p in cell.base_targets.items()}
        cell.measure("l", 240, noise=NOISE)
        exact = identify(cell.dataset(tmp_path / "1", base_targets=declared))
        assert exact.noise_scale > 3.0
        data = cell.dataset(tmp_path / "2", base_targets=declared, base_targets_u_mm=0.5)
        result = identify(data)
        assert dropped(result) == {"d3"}, "the declaration determines what the lengths do not"
        assert 0.85 < result.noise_scale < 1.15
        assert rms(miss(cell, data, result, aligned=True)) < 0.1
        _, covariance = result.predict_with_covariance(data.conditions)
        expected = float(np.sqrt(np.mean(np.trace(covariance, axis1=1, axis2=2))))
        assert 0.2 < expected < 2.0, "half a millimetre of each base target stays in where the world lies"
        assert rms(miss(cell, data, result)) < 2.0 * expected
        assert result.degrees_of_freedom == pytest.approx(240 - (31 + 12) + 6, abs=1)

    def test_points_beside_the_lengths_locate_the_base_targets(self, tmp_path: Path) -> None:
        """Readings with point and length locate unknown base targets in the tracker's world."""
        cell = Cell(place=POSE)
        cell.measure("pl", 80)
        data = cell.dataset(tmp_path, base_targets="free")
        result = identify(data)
        assert dropped(result) == {"d3"}
        assert miss(cell, data, result).max() < 1e-6
        for name, place in cell.base_targets.items():
            found = np.array(result.model.anchors[name])
            found = found + [result.estimate[result.model.index[f"{name}.{k}"]] for k in "xyz"]
            np.testing.assert_allclose(found, place, rtol=0, atol=1e-6)


class TestMixed:
    def campaign(self, noise: Mapping[str, float] | None) -> Cell:
        """Measure one robot with tracker points, camera poses, bar lengths and mixed readings."""
        cell = Cell()
        cell.measure("p", 30, series="tracker", noise=noise)
        cell.measure("po", 20, ["T2"], series="camera", noise=noise)
        cell.measure("l", 60, series="bar", noise=noise)
        cell.measure("pl", 10, series="bar", noise=noise)
        cell.rows[-1]["reading_id"] = "last"
        for i, row in enumerate(cell.rows):
            row["reading_id"] = str(i)
        return cell

    @pytest.mark.parametrize("world", ["free", "nominal"])
    def test_without_noise(self, world: str, tmp_path: Path) -> None:
        cell = self.campaign(None)
        data = cell.dataset(tmp_path, world=world)
        result = identify(data)
        assert result.converged
        assert dropped(result) == {"d3"}
        assert data.numbers == 30 * 3 + 20 * 6 + 60 + 10 * 4 == result.readings.observed.count
        assert miss(cell, data, result).max() < 1e-6

    def test_with_noise(self, tmp_path: Path) -> None:
        cell = self.campaign(NOISE)
        data = cell.dataset(tmp_path)
        result = identify(data)
        assert 0.85 < result.noise_scale < 1.15
        assert rms(miss(cell, data, result)) < 0.05
        held = float(np.sum(result.prior**2 * np.diag(result.covariance)))
        assert result.leverage.shape == (120,)
        assert result.leverage.sum() == pytest.approx(np.sum(result.standard_errors > 0.0) - held, abs=0.2)

    def test_the_weight_of_every_reading_by_hand(self, tmp_path: Path) -> None:
        """The weight of every reading equals r' C^-1 r, computed without the whitener.

        C is the instrument's block and the joints' repeatability by complex derivatives.
        """
        cell = self.campaign(NOISE)
        noise = {"kind": "isotropic", "sigma_mm": 0.03, "rotation_mrad": 0.1, "length_mm": 0.01}
        data = cell.dataset(tmp_path, world="nominal", noise=noise | {"repeatability_deg": 0.01})
        model = ModelStructure(
            ROBOT, (), {s: data.header.targets_of(s) for s in data.conditions.series_names},
            anchors=data.header.base_targets,
        )  # fmt: skip
        readings = readings_of(data, data.fit_rows, model, np.zeros(0))
        got = np.sum(
            readings.observed.residual(BoundModel(model, readings.conditions).frames(np.zeros(0))) ** 2,
            axis=0,
        )
        for i in range(0, len(readings.rows), 7):
            row = readings.rows[i]
            np.testing.assert_allclose(got[i], squared_by_hand(data, int(row)), rtol=1e-8)


def squared_by_hand(data: Dataset, row: int) -> float:
    """Compute the squared whitened residual of a reading at the nominal robot.

    It uses the full covariance.
    """
    c, header = data.conditions, data.header
    target = header.targets_of(c.series_names[c.series[row]])[c.target_names[c.target[row]]]
    pose = chain(ROBOT, c.joints[row], {}, target)
    step = 1e-20
    moved = [chain(ROBOT, c.joints[row], {f"theta{k}": 1j * step}, target).imag / step for k in range(1, 7)]
    raw: list[float] = []
    by_joint: list[Array] = []  # rows of (6,) derivatives
    sigma: list[float] = []
    if data.pointed[row]:
        raw += list(data.points[row] - pose[:3, 3].real)
        by_joint += list(np.array([m[:3, 3] for m in moved]).T)
        sigma += [0.03] * 3
    if data.turned[row]:
        measured = Rotation.from_quat(data.orientation[row], scalar_first=True)
        e = (measured * Rotation.from_matrix(pose[:3, :3].real).inv()).as_rotvec()
        raw += list(e)
        spins = []
        for m in moved:
            w = m[:3, :3] @ pose[:3, :3].real.T  # skew matrix of the angular velocity
            spins.append([w[2, 1], w[0, 2], w[1, 0]])
        by_joint += list(np.array(spins).T)
        sigma += [1e-4] * 3
    if data.spanned[row]:
        way = pose[:3, 3].real - np.array(header.base_targets[c.anchor_names[c.anchor[row]]])
        raw.append(float(data.lengths[row] - np.linalg.norm(way)))
        by_joint.append(np.array([m[:3, 3] for m in moved]) @ way / np.linalg.norm(way))
        sigma.append(0.01)
    jacobian = np.array(by_joint)
    covariance = np.diag(np.array(sigma) ** 2) + np.radians(0.01) ** 2 * jacobian @ jacobian.T
    return float(np.array(raw) @ np.linalg.solve(covariance, np.array(raw)))


@pytest.mark.parametrize(("what", "n"), [("l", 200), ("po", 50), ("pl", 60)])
def test_gross_errors_in_one_of_the_numbers(what: str, n: int, tmp_path: Path) -> None:
    """A length to the wrong base target or an orientation 1 deg off is found and harmless.

    The point of the same reading is good.
    """
    cell = Cell(place=POSE)
    cell.measure(what, n, noise=NOISE, validation=60)
    wrong = {"main-7", "main-19", "main-31"}
    for row in cell.rows:
        if row["reading_id"] not in wrong:
            continue
        if "l" in what:
            row["base_target"] = "B2" if row["base_target"] == "B1" else "B1"
        else:
            read = Rotation.from_quat([row[f"rot_{k}"] for k in "wxyz"], scalar_first=True)
            off = (Rotation.from_rotvec([0.0, np.radians(1.0), 0.0]) * read).as_quat(scalar_first=True)
            row |= zip(("rot_w", "rot_x", "rot_y", "rot_z"), map(float, off), strict=True)
    data = cell.dataset(tmp_path)
    result = identify(data)
    assert wrong <= set(result.faulty_rows)
    assert len(result.faulty_rows) <= 4
    assert 0.85 < result.noise_scale < 1.15
    assert rms(miss(cell, data, result)) < 0.1
