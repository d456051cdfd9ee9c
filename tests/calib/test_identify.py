"""Test the identification.

These would catch: a base model that cannot become the true robot, a prior that biases it, series that share the
wrong parameters, groups that cannot be chosen, and a start that finds no base.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import (
    DataError,
    Dataset,
    IdentificationFit,
    forward,
    identify,
    load_model,
    load_robot,
    read_dataset,
    save_model,
)
from calib.arm.start import base_and_tool
from calib.array import Array
from calib.data import DEFAULT_GROUPS, GROUPS
from calib.diagnose import diagnose
from calib.fit import base_model_of
from calib.fit.held_out import errors_on
from calib.fit.placing import place_nominal
from mocks.campaign import make_campaign
from mocks.world import ROBOTS
from tests.calib.campaigns import Row, exact, move_rows, simulate, true_points, write_files

POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_rotvec([1.9, -1.1, 0.7]).as_matrix()
POSE[:3, 3] = [1800.0, -2500.0, 400.0]


def worst(result: IdentificationFit, data: Dataset, truth: Array) -> float:
    """Largest distance from the truth over all rows, validation rows included, mm."""
    return float(np.linalg.norm(result.predict(data.conditions) - truth, axis=1).max())


class TestWithoutNoise:
    """Positions come back to 1e-6 mm, over rows that took part and over rows that did not."""

    @pytest.mark.parametrize("robot", sorted(ROBOTS))
    def test_the_true_robot_is_found_whatever_noise_is_declared(self, robot: str, tmp_path: Path) -> None:
        """Priors do not bias a fit of readings without noise.

        The declared noise is the usual one of a tracker, about 0.02 mm.
        """
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
        """The same joints and points under another robot's name are refused.

        This shows that the tests above can fail.
        """
        campaign = make_campaign(seed=5, n=80, n_validation=20, effects=[])
        rows, header = exact(campaign)
        with pytest.raises(DataError, match='Set robot = "abb-irb120"'):
            read_dataset(
                write_files(tmp_path, rows, {**header, "robot": "fanuc-lrmate200ic", "world": "free"})
            )


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
    """The Kabsch start is exact for a nominal robot at any pose, even with gross errors."""
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


@pytest.mark.parametrize("share", [0.05, 0.12, 0.2])
@pytest.mark.parametrize("kind", ["any way", "one way", "exchanged"])
def test_a_fifth_of_gross_errors_does_no_harm(kind: str, share: float, tmp_path: Path) -> None:
    """Gross errors of a fifth of the readings do no harm.

    They are in any direction, all in one, or points that belong to other rows.
    """
    _, clean = simulate(tmp_path, seed=3, n=120, n_validation=40, effects=[])
    rng = np.random.default_rng(7)
    rows = np.flatnonzero(clean.fit_rows)
    wrong = rng.choice(rows, int(share * len(rows)), replace=False)
    points = clean.points.copy()
    if kind == "any way":
        points[wrong] += rng.normal(size=(len(wrong), 3)) * rng.uniform(1.0, 100.0, (len(wrong), 1))
    elif kind == "one way":
        points[wrong] += [0.0, 0.0, 25.0]
    else:
        points[wrong] = points[np.roll(wrong, 1)]
    found = identify(replace(clean, points=points))
    held = clean.validation_rows
    miss = np.linalg.norm(found.predict(clean.conditions.take(held)) - clean.points[held], axis=1)
    whole = identify(clean)
    usual = np.linalg.norm(whole.predict(clean.conditions.take(held)) - clean.points[held], axis=1)
    assert np.sqrt(np.mean(miss**2)) < 1.1 * np.sqrt(np.mean(usual**2))


@pytest.mark.parametrize("share", [0.12, 0.2])
def test_a_base_that_moved_late_is_no_crowd_of_gross_errors(share: float, tmp_path: Path) -> None:
    _, clean = simulate(tmp_path, seed=3, n=120, n_validation=0, effects=[])
    order = clean.conditions.order
    points = clean.points + 2.0 * (order >= np.quantile(order, 1.0 - share))[:, None]
    found = diagnose(replace(clean, points=points))
    assert [each.effect.label for each in found.effects] == ["base_shift"]
    assert found.final.faulty_rows == ()


@pytest.mark.parametrize("count", [0, 1, 2, len(GROUPS)])
def test_any_groups_are_fitted(count: int, tmp_path: Path) -> None:
    """Any groups can be fitted: none at all, or without base and tool if both are known."""
    _, data = simulate(tmp_path, seed=4, n=60, n_validation=10, effects=[])
    for groups in combinations(GROUPS, count):
        found = identify(data, groups=groups)
        assert found.converged, groups
        model, estimate = place_nominal(data, base_model_of(data, groups))
        assert np.all(np.isfinite(errors_on(data, data.validation_rows, model, estimate))), groups


def test_series_can_share_one_tool(tmp_path: Path) -> None:
    """A second series whose wrist hardly turned takes its tool from the first.

    It was measured from another station.
    """
    campaign = make_campaign(seed=8, n=120, n_validation=40, effects=[])
    turn, rows = Rotation.from_rotvec([0.1, -0.4, 2.0]), []
    for i, row in enumerate(campaign.rows):
        point = np.array([row[f"{axis}_mm"] for axis in "xyz"])
        other = {} if i % 4 else dict(zip(("x_mm", "y_mm", "z_mm"), turn.apply(point) + 800.0, strict=True))
        rows.append({**row, "series": "A" if i % 4 else "B", **other})
    noise = {"kind": "isotropic", "sigma_mm": 0.03}
    header = {
        **campaign.header,
        "world": "free",
        "noise": noise,
        "model": {"fit": [*DEFAULT_GROUPS, "tool"], "one_tool": True},
    }
    data = read_dataset(write_files(tmp_path, rows, header))
    found = identify(data)
    names = {p.name for p in found.model.parameters}
    assert {"T1.x", "base[A].x", "base[B].x"} <= names
    assert not any(name.startswith(("T1[", "tool[")) for name in names)
    error = errors_on(data, data.validation_rows, found.model, found.estimate)
    of_b = (data.conditions.series == 1)[data.validation_rows]
    for each in (error[of_b], error[~of_b]):
        assert np.sqrt(np.mean(each**2)) < 0.2
    save_model(tmp_path / "m.json", found)
    again = load_model(tmp_path / "m.json")
    np.testing.assert_allclose(
        errors_on(data, data.validation_rows, again.model, again.estimate), error, atol=1e-6
    )
    apart = read_dataset(write_files(tmp_path, rows, {**header, "model": {"fit": header["model"]["fit"]}}))
    assert "T1[A].x" in {p.name for p in identify(apart).model.parameters}
    header["series"] = {"B": {"tool_targets": header["tool_targets"]}}
    with pytest.raises(DataError, match="one tool, and the series 'B' has tool targets of its own"):
        read_dataset(write_files(tmp_path, rows, header))
