"""Identification. These would catch: a base model that cannot become the true robot, a prior or a weight that biases
it, series that share what they must not, redundancy that is not found or not named, gross errors that steer the fit,
standard errors of the wrong size, and results that depend on the order of rows, on names, or on where the world
frame lies.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from calib.dataset import Dataset, read_dataset
from calib.errors import DataError
from calib.identification import Identification
from calib.identify import identify
from calib.kinematics import Array, forward
from calib.placing import base_model_of
from calib.robot import load_robot
from calib.start import base_and_tool
from calib.units import to_internal
from mocks.campaign import Campaign, make_campaign
from mocks.world import ROBOTS
from tests.calib.campaigns import Row, exact, move_rows, simulate, true_points, write_files
from tests.calib.chain import chain

POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_rotvec([1.9, -1.1, 0.7]).as_matrix()
POSE[:3, 3] = [1800.0, -2500.0, 400.0]


def worst(result: Identification, data: Dataset, truth: Array) -> float:
    """Largest distance from the truth over all rows, validation rows included, mm."""
    return float(np.linalg.norm(result.predict(data.conditions) - truth, axis=1).max())


class TestWithoutNoise:
    """Positions come back to 1e-6 mm, over rows that took part and over rows that did not."""

    @pytest.mark.parametrize("robot", sorted(ROBOTS))
    def test_the_true_robot_is_found_whatever_noise_is_declared(self, robot: str, tmp_path: Path) -> None:
        """The usual declaration of a tracker, some 0.02 mm, on readings that have none: priors must not pull."""
        campaign = make_campaign(robot, seed=5, n=80, n_validation=80, effects=[])
        points = true_points(campaign)
        rows = [dict(row) for row in campaign.rows]
        for row, point in zip(rows, points, strict=True):
            row |= {"x_mm": float(point[0]), "y_mm": float(point[1]), "z_mm": float(point[2])}
        data = read_dataset(write_files(tmp_path, rows, campaign.header))
        assert worst(identify(data), data, points) < 1e-6

    @pytest.mark.parametrize("robot", sorted(ROBOTS))
    def test_the_true_robot_is_found(self, robot: str, tmp_path: Path) -> None:
        campaign = make_campaign(robot, seed=5, n=80, n_validation=80, effects=[])
        data = read_dataset(write_files(tmp_path, *exact(campaign)))
        result = identify(data)
        assert result.converged
        assert result.faulty_rows == ()
        assert result.relabelled_rows == ()
        assert data.validation_rows.sum() == 80
        assert campaign.truth["nominal_error_mm"]["mean"] > 0.5
        assert worst(result, data, true_points(campaign)) < 1e-6
        value = dict(zip(result.model.index, result.estimate, strict=True))
        for k in (3,) if robot not in ("ur5", "ur10") else (2, 3):
            # all else being free, the twist of parallel axes itself comes back
            assert value[f"beta{k}"] == pytest.approx(campaign.world.geometry.beta[k - 1], abs=1e-7)
        for k in range(2, 6):
            assert value[f"c{k}"] == pytest.approx(campaign.world.compliance[k - 1], abs=1e-12)

    def test_realistic_noise_declared(self, tmp_path: Path) -> None:
        """Priors and convergence leave nothing that a tracker could see."""
        campaign = make_campaign(seed=5, n=80, n_validation=80, effects=[])
        data = read_dataset(write_files(tmp_path, *exact(campaign, sigma_mm=0.01)))
        assert worst(identify(data), data, true_points(campaign)) < 1e-6

    @pytest.mark.parametrize("robot", ["abb-irb120", "ur10"])
    @pytest.mark.parametrize("turn", [[0, 0, 0], [np.pi, 0, 0], [0, 0, np.pi], [1.9, -1.1, 0.7]])
    def test_the_world_may_lie_anywhere(self, robot: str, turn: list[float], tmp_path: Path) -> None:
        campaign = make_campaign(robot, seed=6, n=80, n_validation=20, effects=[])
        rows, header = exact(campaign)
        pose = POSE.copy()
        pose[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
        move_rows(rows, pose)
        data = read_dataset(write_files(tmp_path, rows, {**header, "world": "free"}))
        result = identify(data)
        truth = true_points(campaign) @ pose[:3, :3].T + pose[:3, 3]
        assert result.converged
        assert worst(result, data, truth) < 1e-6

    def test_tool_targets_unknown(self, tmp_path: Path) -> None:
        campaign = make_campaign(seed=7, n=100, n_validation=20, effects=[])
        rows, header = exact(campaign)
        wrong = {name: [x + 30.0, y - 20.0, z + 40.0] for name, (x, y, z) in header["tool_targets"].items()}
        header |= {"tool_targets": wrong, "world": "free"}
        header["model"] = {"fit": [*header["model"]["fit"], "tool"]}
        move_rows(rows, POSE)
        data = read_dataset(write_files(tmp_path, rows, header))
        result = identify(data)
        truth = true_points(campaign) @ POSE[:3, :3].T + POSE[:3, 3]
        assert worst(result, data, truth) < 1e-6
        confounded = {drop.name for drop in result.dropped}
        assert confounded & {"alpha6", "a6", "theta6", "d6"}, (
            "the tool and link 6 share its gauge: link 6 gives way"
        )

    @pytest.mark.parametrize("free", [True, False])
    def test_several_series_share_the_robot(self, free: bool, tmp_path: Path) -> None:
        """Three set-ups of one arm: own base, own tool, own targets."""
        rows: list[Row] = []
        truth = []
        header: dict[str, Any] = {}
        poses = [np.eye(4), POSE, np.linalg.inv(POSE)]
        for i, (name, pose) in enumerate(zip(("day", "night", "later"), poses, strict=True)):
            shift = 15.0 * i
            targets = {"T1": (shift, 0.0, 125.0), f"N{i}": (80.0, -40.0 - shift, 150.0 + shift)}
            campaign = make_campaign(seed=8, n=50, n_validation=10, effects=[], targets=targets)
            part, head = exact(campaign)
            if free:
                move_rows(part, pose)
            for row in part:
                rows.append({**row, "series": name, "reading_id": f"{name}-{row['reading_id']}"})
                truth.append([row["x_mm"], row["y_mm"], row["z_mm"]])
            header = header or {
                **head,
                "world": "free" if free else "nominal",
                "series": {},
                "tool_targets": {},
            }
            nominal = {t: list(p) for t, p in targets.items()}
            if free:
                nominal = {t: [x + 12.0, y - 9.0, z + 20.0] for t, (x, y, z) in nominal.items()}
            header["series"][name] = {"tool_targets": nominal}
        if free:
            header["model"] = {"fit": ["base", "geometry", "parallel_twist", "compliance", "tool"]}
        data = read_dataset(write_files(tmp_path, rows, header))
        result = identify(data)
        assert data.conditions.series_names == ("day", "later", "night")
        labels = [e.label for e in result.model.effects]
        assert [x for x in labels if x.startswith("base")] == ["base[day]", "base[later]", "base[night]"]
        assert len([x for x in labels if x.startswith("tool")]) == (3 if free else 0)
        assert result.converged
        assert worst(result, data, np.array(truth)) < 1e-6

    def test_joints_as_the_fanuc_controller_counts_them(self, tmp_path: Path) -> None:
        campaign = make_campaign("fanuc-lrmate200ic", seed=5, n=60, n_validation=20, effects=[])
        rows, header = exact(campaign)
        robot = load_robot("fanuc-lrmate200ic")
        matrix = robot.joint_matrices["fanuc-j23"]
        for row in rows:
            for names in ("j{}_deg", "prev{}_deg"):
                model = np.radians([row[names.format(k)] for k in range(1, 7)])
                controller = np.degrees(
                    np.linalg.solve(np.array(matrix.matrix), model - np.array(matrix.offset))
                )
                row |= {names.format(k + 1): float(angle) for k, angle in enumerate(controller)}
        coupled = {**header, "joint_coupling": "fanuc-j23", "beyond_limits": True}
        data = read_dataset(write_files(tmp_path / "1", rows, coupled))
        assert worst(identify(data), data, true_points(campaign)) < 1e-6
        with pytest.raises(DataError, match='Set joint_coupling = "fanuc-j23"'):
            read_dataset(write_files(tmp_path / "2", rows, header))

    def test_another_robots_name_is_refused(self, tmp_path: Path) -> None:
        """The same joints and points under another robot's name do not fit: nothing above passes by itself."""
        campaign = make_campaign(seed=5, n=80, n_validation=20, effects=[])
        rows, header = exact(campaign)
        with pytest.raises(DataError, match='Set robot = "abb-irb120"'):
            read_dataset(
                write_files(tmp_path, rows, {**header, "robot": "fanuc-lrmate200ic", "world": "free"})
            )


@pytest.mark.parametrize(
    ("robot", "expected"),
    [("abb-irb120", {"d3": {"d2"}}), ("ur10", {"d3": {"d2"}, "d4": {"d2"}, "c6": set()})],
)
def test_redundant_parameters_are_found_and_named(
    robot: str, expected: dict[str, set[str]], tmp_path: Path
) -> None:
    """Parallel axes: sliding along them is one freedom. A UR's last joint carries no load."""
    _, data = simulate(tmp_path, robot, seed=2, n=30, n_validation=0, effects=[])
    result = identify(data)
    assert {drop.name: set(drop.confounded_with) for drop in result.dropped} == expected
    for name, others in expected.items():
        assert any(name in warning and all(o in warning for o in others) for warning in result.warnings)
        position = result.model.index[name]
        assert result.estimate[position] == 0.0
        assert result.standard_errors[position] == 0.0
    active = len(result.estimate) - len(result.dropped)
    assert result.degrees_of_freedom == 3 * len(result.readings.rows) - active
    # told independently: the rank of the derivative of plain matrices
    columns = reference_problem(data, result)["jacobian"](np.zeros(active))
    everything = reference_problem(data, result, drop=False)["jacobian"](np.zeros(len(result.estimate)))
    rows = 3 * len(result.readings.rows)  # without the prior
    lengths = [np.linalg.norm(c[:rows], axis=0) for c in (columns, everything)]
    ranks = [
        int(np.linalg.matrix_rank(c[:rows] / np.maximum(size, 1e-9 * size.max()), tol=1e-6))
        for c, size in zip((columns, everything), lengths, strict=True)
    ]
    assert ranks == [active, active]


def test_a_target_on_the_axis_leaves_rank_26(tmp_path: Path) -> None:
    """Thesis: with T1 alone, 26 of the 31 parameters are seen. Ours says so before it fits anything."""
    campaign = make_campaign(seed=2, n=60, n_validation=0, effects=[], targets={"T1": (0.0, 0.0, 125.0)})
    header = {**campaign.header, "model": {"fit": ["base", "geometry", "compliance"]}}
    header["tool_targets"] = {"T1": [0.0, 1.5, 125.0]}  # just far enough off the axis to be let through
    data = read_dataset(write_files(tmp_path, campaign.rows, header))
    result = identify(data)
    assert any("hardly seen" in w for w in result.warnings)


class TestGrossErrors:
    """5 % of the readings 2 mm off and 4 % with a wrong target name: found, each by its id, and harmless."""

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


def reference_problem(data: Dataset, result: Identification, *, drop: bool = True) -> dict[str, Any]:
    """The fit as a textbook would write it: matrices, loops, derivative by complex numbers."""
    model = result.model
    dropped = {d.name for d in result.dropped} if drop else set()
    names = [p.name for p in model.parameters if p.name not in dropped]
    # The prior weighs with the noise that the robust passes found: taken from the result, and looked at.
    size = []
    for p, weight in zip(model.parameters, result.prior, strict=True):
        usual = to_internal(p.size, p.unit) if p.size else np.inf
        if p.size and p.name not in dropped and p.name not in {d.name for d in result.dropped}:
            assert weight * usual == pytest.approx(result.noise_scale, rel=0.5)
            usual = 1.0 / weight
        if p.name in names:
            size.append(usual)
    rows = result.readings.rows
    noise = data.header.noise
    whiteners, measured = [], data.points[rows]
    for point in measured:
        beam = point - np.array(noise.station_mm)
        distance = np.linalg.norm(beam)
        beam = beam / distance
        along = noise.range_mm + noise.range_ppm * 1e-6 * distance
        across = noise.transverse_mm + noise.transverse_ppm * 1e-6 * distance
        # symmetric root: sums of squares are those of any other root
        whiteners.append(np.eye(3) / across + np.outer(beam, beam) * (1.0 / along - 1.0 / across))
    c = data.conditions

    def point(x: Any, i: int) -> Any:
        add: dict[str, Any] = {}
        for name, value in zip(names, x, strict=True):
            slot, amount = name, value
            if name[0] == "c" and name[1:].isdigit():
                slot, amount = f"theta{name[1:]}", value * c.torque[i, int(name[1:]) - 1]
            add[slot] = add.get(slot, 0.0) + amount
        target = data.header.targets_of("main")[c.target_names[c.target[i]]]
        return chain(model.robot, c.joints[i], add, target)[:3, 3]

    def residual(x: Array) -> Array:
        parts = [w @ (m - point(x, i).real) for w, m, i in zip(whiteners, measured, rows, strict=True)]
        return np.concatenate([*parts, -x / np.array(size)])

    def jacobian(x: Array) -> Array:
        out = []
        for k in range(len(x)):
            step = x.astype(complex)
            step[k] += 1e-30j
            parts = [-w @ point(step, i).imag / 1e-30 for w, i in zip(whiteners, rows, strict=True)]
            out.append(np.concatenate(parts))
        return np.vstack([np.column_stack(out), -np.diag(1.0 / np.array(size))])

    return {"names": names, "residual": residual, "jacobian": jacobian}


@pytest.mark.parametrize("robot", ["abb-irb120", "ur10"])
def test_the_estimate_is_that_of_an_independent_program(robot: str, tmp_path: Path) -> None:
    """scipy.optimize.least_squares on the documented cost: estimate to 1e-8, standard errors to 1e-6."""
    campaign = make_campaign(
        robot, seed=4, n=20, n_validation=0, effects=[], noise_declared_factor=1.4, repeatability_deg=0.0
    )
    data = read_dataset(write_files(tmp_path, campaign.rows, campaign.header))
    result = identify(data)
    assert result.faulty_rows == ()
    assert result.relabelled_rows == ()
    problem = reference_problem(data, result)
    start = np.zeros(len(problem["names"]))
    size = 1.0 / np.linalg.norm(problem["jacobian"](start), axis=0)
    scaled = least_squares(
        lambda u: problem["residual"](u * size),
        start,
        jac=lambda u: problem["jacobian"](u * size) * size,  # pyright: ignore[reportArgumentType]
        method="lm",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    reference = scaled.x * size
    for _ in range(2):  # MINPACK stops where the cost no longer falls, half the digits of the estimate away
        step, *_ = np.linalg.lstsq(
            problem["jacobian"](reference) * size, problem["residual"](reference), rcond=None
        )
        reference = reference - step * size
    places = [result.model.index[name] for name in problem["names"]]
    columns = problem["jacobian"](reference) * size
    spread = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns))) * size
    left = problem["residual"](reference)[: 3 * len(result.readings.rows)]
    scale = np.sqrt(np.sum(left**2) / (len(left) - len(reference)))
    assert scale < 1.0
    assert result.noise_scale == pytest.approx(scale, rel=1e-7)
    assert np.sum(result.residual**2) == pytest.approx(np.sum(left**2), rel=1e-9)
    np.testing.assert_allclose(result.standard_errors[places], spread, rtol=1e-6)
    # relative to the value, or where the value is nearly nothing, to its standard error
    limit = 1e-8 * np.maximum(np.abs(reference), spread)
    assert np.all(np.abs(result.estimate[places] - reference) < limit), (
        np.abs(result.estimate[places] - reference) / limit
    )


def test_standard_errors_are_those_of_repetition(tmp_path: Path) -> None:
    """Over many campaigns, parameters scatter about the truth as they say they do: squares sum to chi-square."""
    total, count = 0.0, 0
    for seed in range(100, 116):
        campaign, data = simulate(tmp_path / str(seed), seed=seed, n=60, n_validation=0, effects=[])
        result = identify(data)
        value = dict(zip(result.model.index, result.estimate, strict=True))
        spread = dict(zip(result.model.index, result.standard_errors, strict=True))
        geometry = campaign.world.geometry
        truth = {f"c{k}": campaign.world.compliance[k - 1] for k in range(3, 6)} | {
            "beta3": geometry.beta[2],
            "alpha4": geometry.alpha[3] - result.model.robot.alpha[3],
            "d4": geometry.d[3] - result.model.robot.d[3],
        }
        for name, expected in truth.items():
            total += ((value[name] - expected) / spread[name]) ** 2
            count += 1
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], count)
    # parameters of one campaign are correlated: allow for it by half as much again
    assert low / 1.5 < total < 1.5 * high


class TestMetamorphic:
    """What must not matter does not matter."""

    campaign: Campaign = make_campaign(
        seed=9, n=60, n_validation=20, effects=[], gross_rows=2, swapped_rows=2
    )

    def identified(
        self, folder: Path, rows: list[Row], header: dict[str, Any]
    ) -> tuple[Dataset, Identification, dict[str, Array]]:
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
        for row in rows:
            if row["set"] == "validation":
                row |= {"x_mm": 1e6, "y_mm": -3e5, "z_mm": 7.0}
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


def test_groups_can_be_chosen(tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=2, n=60, n_validation=0, effects=[])
    errors = []
    for groups in (("base",), ("base", "joint_offsets"), ("base", "geometry"), None):
        result = identify(data, groups=groups)
        errors.append(result.noise_scale)
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1.2 < errors[-2]
    assert [e.label for e in base_model_of(data, ("base", "encoder_scale")).effects] == [
        "base",
        "encoder_scale",
    ]


def test_the_start_finds_any_base(tmp_path: Path) -> None:
    """Kabsch start: exact where the robot is nominal, whatever the pose, with gross errors among the readings."""
    _, data = simulate(tmp_path, seed=2, n=60, n_validation=0, effects=[])
    flange = forward(data.header.robot, data.conditions.joints)
    targets = np.array([[0.0, 0.0, 125.0], [75.0, 93.675, 215.0], [150.0, 0.0, 125.0]])
    which = data.conditions.target
    nominal = np.einsum("nij,nj->ni", flange[:, :3, :3], targets[which]) + flange[:, :3, 3]
    measured = nominal @ POSE[:3, :3].T + POSE[:3, 3]
    pose, tool = base_and_tool(flange, targets, which, measured, tool_unknown=False)
    np.testing.assert_allclose(pose, POSE, atol=1e-9)
    np.testing.assert_array_equal(tool, targets)
    pose, tool = base_and_tool(flange, targets + 5.0, which, measured, tool_unknown=True)
    back = np.einsum("nij,nj->ni", flange[:, :3, :3], tool[which]) + flange[:, :3, 3]
    miss = np.linalg.norm(back @ pose[:3, :3].T + pose[:3, 3] - measured, axis=1)
    assert miss.max() < 1.0
