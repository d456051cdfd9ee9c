"""Forward kinematics and gravity torques against numbers computed by another program."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mocks.world.gravity import moments, torques
from mocks.world.kinematics import Geometry, frames, link_transform, nominal_geometry
from mocks.world.robots import IRB120, LRMATE200IC, ROBOTS, UR5, robot_named
from mocks.world.transforms import place, rx, ry, rz, shift, turn

VECTORS = Path(__file__).parent.parent / "vectors"
THESIS = json.loads((VECTORS / "fk_thesis.json").read_text(encoding="utf-8"))
UR5_VECTORS = json.loads((VECTORS / "fk_ur5.json").read_text(encoding="utf-8"))
THESIS_ROBOTS = {"IRB120": IRB120, "LRMATE200iC": LRMATE200IC}


def calibrated(robot_name: str, p31: list[float]) -> tuple[Geometry, list[float]]:
    """Return geometry and compliances from the 31 parameters.

    These are base, (alpha, a, theta, d) of links 2..6, c_2..c_6.
    """
    g = nominal_geometry(THESIS_ROBOTS[robot_name])
    g.base_mm, g.base_rad = p31[0:3], p31[3:6]
    for i in range(1, 6):
        alpha, a, theta, d = p31[6 + 4 * (i - 1) : 10 + 4 * (i - 1)]
        g.alpha[i] += alpha
        g.a[i] += a
        g.theta[i] += theta
        g.d[i] += d
    return g, [0.0, *p31[26:31]]


@pytest.mark.parametrize("case", sorted({v["case"] for v in THESIS["vectors"]}))
def test_thesis_vectors(case: str) -> None:
    vectors: list[dict[str, Any]] = [v for v in THESIS["vectors"] if v["case"] == case]
    assert len(vectors) == 20
    for v in vectors:
        robot = THESIS_ROBOTS[v["robot"]]
        q = [math.radians(x) for x in v["q_deg"]]
        nominal = frames("mdh", nominal_geometry(robot), q)
        tau = torques("mdh", nominal, moments("mdh", nominal, robot.loads))
        np.testing.assert_allclose(tau, v["tau_Nmm"], rtol=0.0, atol=THESIS["tol"]["tau_Nmm"])
        geometry, compliance = nominal_geometry(robot), [0.0] * 6
        if "p31" in v:
            geometry, compliance = calibrated(v["robot"], v["p31"])
        angles = [a + c * t for a, c, t in zip(q, compliance, tau, strict=True)]
        flange = frames("mdh", geometry, angles)[-1]
        expected = np.array(v["T_world_flange"])
        np.testing.assert_allclose(flange[:3, :3], expected[:3, :3], rtol=0.0, atol=THESIS["tol"]["rot"])
        np.testing.assert_allclose(flange[:3, 3], expected[:3, 3], rtol=0.0, atol=THESIS["tol"]["pos_mm"])
        points = [place(flange, p) for p in v["tool_points_flange_mm"]]
        np.testing.assert_allclose(points, v["tool_points_world_mm"], rtol=0.0, atol=THESIS["tol"]["pos_mm"])


def test_ur5_vectors() -> None:
    for v in UR5_VECTORS["vectors"]:
        q = [math.radians(x) for x in v["q_deg"]]
        # the vectors count in metres, their d6 ends at the reflector
        flange = frames("dh", nominal_geometry(UR5), q)[-1] @ shift(0.0, 0.0, 169.5)
        flange[:3, 3] /= 1000.0
        np.testing.assert_allclose(flange, v["T"], rtol=0.0, atol=UR5_VECTORS["tol"])


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_torque_is_the_slope_of_the_potential_energy(name: str) -> None:
    robot = robot_named(name)
    rng = np.random.default_rng(5)

    def energy(q: np.ndarray) -> float:
        chain = frames(robot.convention, nominal_geometry(robot), q.tolist())
        return sum(9.81 * load.mass_kg * place(chain[load.link], load.cog_mm)[2] for load in robot.loads)

    q = rng.uniform(-2.0, 2.0, 6)
    chain = frames(robot.convention, nominal_geometry(robot), q.tolist())
    tau = torques(robot.convention, chain, moments(robot.convention, chain, robot.loads))
    for i in range(6):
        dq = np.zeros(6)
        dq[i] = 1e-6
        assert tau[i] == pytest.approx(-(energy(q + dq) - energy(q - dq)) / 2e-6, abs=1e-3)


@pytest.mark.parametrize("beta", [0.0, 0.02])
def test_link_is_the_product_of_its_elementary_motions(beta: float) -> None:
    alpha, a, theta, d = 0.3, 40.0, -1.1, 70.0
    modified = rx(alpha) @ ry(beta) @ shift(a, 0, 0) @ rz(theta) @ shift(0, 0, d)
    standard = rz(theta) @ shift(0, 0, d) @ shift(a, 0, 0) @ rx(alpha) @ ry(beta)
    np.testing.assert_allclose(link_transform("mdh", alpha, beta, a, theta, d), modified, atol=1e-12)
    np.testing.assert_allclose(link_transform("dh", alpha, beta, a, theta, d), standard, atol=1e-12)


def test_turn_about_each_axis() -> None:
    np.testing.assert_allclose(turn([0.4, 0, 0]), rx(0.4), atol=1e-15)
    np.testing.assert_allclose(turn([0, 0.4, 0]), ry(0.4), atol=1e-15)
    np.testing.assert_allclose(turn([0, 0, 0.4]), rz(0.4), atol=1e-15)
    np.testing.assert_array_equal(turn([0, 0, 0]), np.eye(4))


def test_unknown_robot_is_named() -> None:
    with pytest.raises(ValueError, match="kuka"):
        robot_named("kuka")
