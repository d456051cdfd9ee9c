"""Test that identification is independent of irrelevant input.

These would catch: gross errors that affect the fit, and results that depend on the order of rows, on names, on
validation rows, or on the position of the world frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import Dataset, IdentificationFit, identify, read_dataset
from calib.array import Array
from mocks.campaign import Campaign, make_campaign
from tests.calib.campaigns import Row, move_rows, simulate, true_points, write_files

POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_rotvec([1.9, -1.1, 0.7]).as_matrix()
POSE[:3, 3] = [1800.0, -2500.0, 400.0]


class TestGrossErrors:
    """Gross errors are found, each by its id, and do not affect the fit.

    5 % of the readings are 2 mm off, and 4 % have a wrong target name.
    """

    @pytest.mark.parametrize("seed", [1, 2, 3])
    def test_they_are_found_and_do_not_steer(self, seed: int, tmp_path: Path) -> None:
        options: dict[str, Any] = {"seed": seed, "n": 200, "n_validation": 100, "effects": []}
        campaign, data = simulate(tmp_path / "bad", **options, gross_rows=10, swapped_rows=8)
        _, clean_data = simulate(tmp_path / "good", **options)
        result = identify(data)
        wrong = {str(i) for i in campaign.truth["faulty_rows"]}
        swapped = {(str(i), written, true) for i, written, true in campaign.truth["relabelled_rows"]}
        assert (len(wrong), len(swapped)) == (10, 8)
        assert wrong <= set(result.faulty_rows)
        assert len(result.faulty_rows) <= 11  # 99 % confidence: one more may happen
        assert {tuple(map(str, r)) for r in result.relabelled_rows} == swapped
        assert any("left out" in w for w in result.warnings)
        assert any("relabelled" in w for w in result.warnings)
        undisturbed = identify(clean_data)
        rows = data.validation_rows
        truth = true_points(campaign)[rows]
        errors = [
            np.sqrt(np.mean((r.predict(data.conditions.take(rows)) - truth) ** 2))
            for r in (result, undisturbed)
        ]
        assert errors[0] < 1.3 * errors[1]
        assert 0.9 < result.noise_scale < 1.1

    def test_nothing_is_called_faulty_in_clean_sets(self, tmp_path: Path) -> None:
        called = []
        for seed in range(20, 28):
            _, data = simulate(tmp_path / str(seed), seed=seed, n=100, n_validation=0, effects=[])
            result = identify(data)
            assert result.relabelled_rows == ()
            called += result.faulty_rows
        assert len(called) <= 2


class TestMetamorphic:
    """Irrelevant changes of the input do not affect the result."""

    campaign: Campaign = make_campaign(
        seed=9, n=60, n_validation=20, effects=[], gross_rows=2, swapped_rows=2
    )

    def identified(
        self, folder: Path, rows: list[Row], header: dict[str, Any]
    ) -> tuple[Dataset, IdentificationFit, dict[str, Array]]:
        data = read_dataset(write_files(folder, rows, header))
        result = identify(data)
        predicted = result.predict(data.conditions)
        return data, result, dict(zip(data.reading_id, predicted, strict=True))

    def compare(self, one: dict[str, Array], other: dict[str, Array], limit: float = 1e-8) -> None:
        assert one.keys() == other.keys()
        assert len(one) == 80
        assert max(np.linalg.norm(one[name] - other[name]) for name in one) < limit

    def rows(self) -> list[Row]:
        return [dict(row) for row in self.campaign.rows]

    def test_order_of_rows(self, tmp_path: Path) -> None:
        _, plain, before = self.identified(tmp_path / "1", self.rows(), self.campaign.header)
        rows = self.rows()
        shuffled = [rows[i] for i in np.random.default_rng(0).permutation(len(rows))]
        _, other, after = self.identified(tmp_path / "2", shuffled, self.campaign.header)
        self.compare(before, after)
        assert set(plain.faulty_rows) == set(other.faulty_rows) != set()
        assert set(plain.relabelled_rows) == set(other.relabelled_rows) != set()

    def test_names_of_targets_and_readings(self, tmp_path: Path) -> None:
        _, plain, before = self.identified(tmp_path / "1", self.rows(), self.campaign.header)
        new = {"T1": "zenith", "T2": "alpha", "T3": "Meßkugel 3"}  # another order in the alphabet
        rows = [{**row, "tool_target": new[row["tool_target"]]} for row in self.rows()]
        targets = {new[name]: point for name, point in self.campaign.header["tool_targets"].items()}
        _, other, after = self.identified(
            tmp_path / "2", rows, {**self.campaign.header, "tool_targets": targets}
        )
        self.compare(before, after)
        assert {(a, new[b], new[c]) for a, b, c in plain.relabelled_rows} == set(other.relabelled_rows)

    def test_where_the_world_lies(self, tmp_path: Path) -> None:
        header = {**self.campaign.header, "world": "free"}
        _, plain, before = self.identified(tmp_path / "1", self.rows(), header)
        rows = self.rows()
        move_rows(rows, POSE)
        station = POSE[:3, :3] @ np.array(header["noise"]["station_mm"]) + POSE[:3, 3]
        noise = {**header["noise"], "station_mm": station.tolist()}
        _, other, after = self.identified(tmp_path / "2", rows, {**header, "noise": noise})
        back = {name: POSE[:3, :3].T @ (point - POSE[:3, 3]) for name, point in after.items()}
        self.compare(before, back, 1e-6)
        assert set(plain.faulty_rows) == set(other.faulty_rows)
        np.testing.assert_allclose(
            other.standard_errors[6:], plain.standard_errors[6:], rtol=1e-3, atol=1e-15
        )

    def test_nominal_and_free_world_agree(self, tmp_path: Path) -> None:
        _, _, before = self.identified(tmp_path / "1", self.rows(), self.campaign.header)
        _, _, after = self.identified(tmp_path / "2", self.rows(), {**self.campaign.header, "world": "free"})
        self.compare(before, after, 1e-4)

    def test_unit_of_the_noise(self, tmp_path: Path) -> None:
        """Half the declared noise: the same robot, twice the noise scale."""
        _, plain, before = self.identified(tmp_path / "1", self.rows(), self.campaign.header)
        noise = self.campaign.header["noise"]
        half = {k: 0.5 * v if isinstance(v, float) else v for k, v in noise.items()}
        _, other, after = self.identified(
            tmp_path / "2", self.rows(), {**self.campaign.header, "noise": half}
        )
        assert other.noise_scale == pytest.approx(2.0 * plain.noise_scale, rel=0.02)
        self.compare(before, after, 2e-3)

    def test_validation_rows_do_not_matter(self, tmp_path: Path) -> None:
        data, plain, before = self.identified(tmp_path / "1", self.rows(), self.campaign.header)
        rows = self.rows()
        for number, row in enumerate(rows):
            if row["set"] == "validation":
                row |= {"x_mm": 1e6 + 10.0 * number, "y_mm": -3e5, "z_mm": 7.0}
        other_data, other, after = self.identified(tmp_path / "2", rows, self.campaign.header)
        assert not np.array_equal(data.points, other_data.points)
        np.testing.assert_array_equal(plain.estimate, other.estimate)
        np.testing.assert_array_equal(plain.covariance, other.covariance)
        np.testing.assert_array_equal(plain.residual, other.residual)
        assert (plain.faulty_rows, plain.relabelled_rows) == (other.faulty_rows, other.relabelled_rows)
        self.compare(before, after, 1e-300)
        rows = [row for row in self.rows() if row["set"] != "validation"]
        alone = identify(read_dataset(write_files(tmp_path / "3", rows, self.campaign.header)))
        np.testing.assert_array_equal(plain.estimate, alone.estimate)

    def test_rejected_rows_do_not_matter(self, tmp_path: Path) -> None:
        rows = self.rows()
        for row in rows[10:14]:
            row |= {"status": "rejected:beam", "x_mm": 1e5}
        with_them = identify(read_dataset(write_files(tmp_path / "1", rows, self.campaign.header)))
        without = identify(
            read_dataset(write_files(tmp_path / "2", rows[:10] + rows[14:], self.campaign.header))
        )
        np.testing.assert_array_equal(with_them.estimate, without.estimate)
