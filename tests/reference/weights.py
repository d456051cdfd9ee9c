"""Declared covariance of a reading: the instrument's, and the repeatability of the joints.

A tracker's sigma is fixed + ppm x distance, along the beam to the measured point and across it; a row's own
uncertainty overrides what the header declares.
"""

from __future__ import annotations

from decimal import Decimal

import numpy as np

from tests.reference.chain import target_frame
from tests.reference.decimals import Matrix, cholesky, degrees, diagonal, norm, rotation_vector, zeros
from tests.reference.problem import ZERO, Problem, Reading, distance, slots, vector

STEP = Decimal("1e-16")  # of the central differences: their error is its square


def whitener(problem: Problem, reading: Reading) -> Matrix:
    """Compute L (k, k) with L L' the declared covariance of a reading.

    It consists of the instrument's covariance and of the repeatability of the joints. The latter goes through the
    joint Jacobian of point, orientation and distance together, at the nominal robot.
    """
    instrument = _instrument(problem, reading)
    repeatability = degrees(Decimal(problem.noise.get("repeatability_deg", 0)))
    columns = _joint_jacobian(problem, reading) * repeatability
    return cholesky(instrument + columns @ columns.T)


def _instrument(problem: Problem, reading: Reading) -> Matrix:
    noise, given = problem.noise, reading.uncertainty
    blocks: list[Matrix] = []
    if reading.point is not None:
        if "u_x_mm" in given:
            blocks.append(diagonal([given[f"u_{axis}_mm"] ** 2 for axis in "xyz"]))
        elif noise["kind"] == "tracker":
            beam = reading.point - vector(noise["station_mm"])
            away = norm(beam)
            part = {
                way: Decimal(noise[f"{way}_mm"])
                + Decimal(noise.get(f"{way}_ppm", 0)) * Decimal("1e-6") * away
                for way in ("range", "transverse")
            }
            along = np.outer(beam / away, beam / away)
            across = diagonal([Decimal(1)] * 3) - along
            blocks.append(along * part["range"] ** 2 + across * part["transverse"] ** 2)
        else:
            blocks.append(diagonal([Decimal(noise["sigma_mm"]) ** 2] * 3))
    if reading.rotation is not None:
        mrad = given.get("u_rot_mrad", Decimal(noise.get("rotation_mrad", 0)))
        blocks.append(diagonal([(mrad / 1000) ** 2] * 3))
    if reading.length is not None:
        mm = given.get("u_length_mm", Decimal(noise.get("length_mm", 0)))
        blocks.append(np.array([[mm**2]]))
    size = sum(len(block) for block in blocks)
    out, at = zeros(size, size), 0
    for block in blocks:
        out[at : at + len(block), at : at + len(block)] += block
        at += len(block)
    return out


def _joint_jacobian(problem: Problem, reading: Reading) -> Matrix:
    """Differentiate every row by each joint of the nominal robot, (k, N).

    The derivatives are central differences.
    """
    zero = dict.fromkeys((p.name for p in problem.parameters), ZERO)
    add = slots(problem, reading, zero)
    columns = []
    for k in range(1, len(reading.angles) + 1):
        ends = []
        for side in (STEP, -STEP):
            turned = {**add, f"theta{k}": add.get(f"theta{k}", ZERO) + side}
            ends.append(target_frame(problem.arm, reading.angles, turned))
        up, down = ends
        rows: list[Decimal] = []
        if reading.point is not None:
            rows += list(up[:3, 3] - down[:3, 3])
        if reading.rotation is not None:
            rows += list(rotation_vector(up[:3, :3] @ down[:3, :3].T))
        if reading.length is not None:
            rows.append(distance(reading, add, up) - distance(reading, add, down))
        columns.append(np.array(rows) / (2 * STEP))
    return np.array(columns).T
