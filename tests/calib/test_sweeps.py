"""Test sweeps of single joints.

These would catch: degrees for radians, a reversal of the wrong sign or halved, and an error range that the reversal
inflates. They would also catch an axis compared with that of another joint, sweeps found without cause, and a ripple of
the radius taken for a wobble of the axis.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib import DataError, Dataset, identify
from calib.sweeps import JointSweep, analyse
from calib.units import DEG
from service.cli import main
from tests.benchmarks.coverage import RANGE
from tests.calib.campaigns import write_files
from tests.calib.cells import Cell

HOME = (10.0, 20.0, -10.0, 5.0, 30.0, 0.0)
RANGES = {1: (-60.0, 60.0), 2: (-40.0, 40.0), 5: (-90.0, 90.0)}
GAP = {1: 0.02, 5: -0.03}  # deg, up less down
WAVE = 0.05  # deg, three times a turn, of joint 5
NOISE = 0.005
RIPPLE, WOBBLE = 0.08, 0.05  # mm, along radius and axis, three times and twice per turn


def cell(step: float = 5.0) -> Cell:
    """Sixty poses, and sweeps of three joints up and down."""
    out = Cell()
    out.soft = np.zeros(6)
    poses = np.degrees(out.rng.uniform(RANGE[:, 0], RANGE[:, 1], (60, 6)))
    drive(out, poses, np.ones((60, 6)))
    for joint, (low, high) in RANGES.items():
        up = np.arange(low, high + 1e-9, step)
        sides = np.ones((2 * len(up), 6))
        sides[len(up) :, joint - 1] = -1
        commanded = np.tile(HOME, (len(sides), 1))
        commanded[:, joint - 1] = np.append(up, up[::-1])
        drive(out, commanded, sides)
    return out


def drive(out: Cell, commanded: NDArray[np.float64], sides: NDArray[np.float64]) -> None:
    """Measure at commanded angles (n, 6), deg, reached from these sides with the arm's errors."""
    real = commanded.copy()
    for joint, gap in GAP.items():
        real[:, joint - 1] += 0.5 * gap * sides[:, joint - 1]
    real[:, 4] += WAVE * np.sin(3.0 * np.radians(commanded[:, 4]))
    before = len(out.rows)
    out.measure("p", len(real), ["T2"], noise={"p": NOISE}, validation=0, joints=np.radians(real))
    for row, q, side in zip(out.rows[before:], commanded, sides, strict=True):
        row["reading_id"] = f"{before}-{row['reading_id']}"
        row |= {f"j{k + 1}_deg": float(q[k]) for k in range(6)}
        row |= {f"approach{k + 1}": int(side[k]) for k in range(6)}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return cell().dataset(tmp_path_factory.mktemp("sweeps"))


def by_joint(dataset: Dataset) -> dict[int, JointSweep]:
    return {sweep.joint: sweep for sweep in analyse(dataset)}


def test_error_range_and_reversal_of_every_joint(dataset: Dataset) -> None:
    found = by_joint(dataset)
    # two of each are of the other sweeps, where they pass this posture from the usual sides; from others they stay out
    assert {joint: len(sweep.angle) for joint, sweep in found.items()} == {1: 50 + 2, 2: 34 + 2, 5: 74 + 2}
    for joint, sweep in found.items():
        assert sweep.u_reversal is not None
        assert sweep.reversal is not None
        assert sweep.reversal / DEG == pytest.approx(GAP.get(joint, 0.0), abs=4.0 * sweep.u_reversal / DEG)
        places = len(sweep.places)
        assert sweep.u_reversal * sweep.radius == pytest.approx(NOISE * np.sqrt(2.0 / places), rel=0.5)
        assert (sweep.angle.min() / DEG, sweep.angle.max() / DEG) == pytest.approx(RANGES[joint])
    assert found[5].error_range / DEG == pytest.approx(2.0 * WAVE, abs=0.01)
    quiet = 6.0 * NOISE / found[1].radius  # the reversal is not part of it
    assert found[1].error_range < quiet
    wave = np.polyfit(np.sin(3.0 * found[5].places), found[5].error / DEG, 1)[0]
    assert wave == pytest.approx(WAVE, rel=0.05)


def test_the_axes_are_those_of_the_identified_arm(dataset: Dataset) -> None:
    for sweep in analyse(dataset, identify(dataset)):
        assert sweep.axis is not None
        assert sweep.axis.angle < 0.01 * DEG + 4.0 * sweep.axis.u_angle
        # the identified arm lacks the wave of joint 5, which moves its points by 0.26 mm
        assert sweep.axis.distance < 0.1 + 4.0 * sweep.axis.u_distance
        assert sweep.joint != 2 or sweep.axis.u_distance < 3.0 * NOISE


def test_deviations_along_radius_and_axis_are_told_apart(tmp_path: Path) -> None:
    out = Cell()
    out.soft = np.zeros(6)
    commanded = np.tile(HOME, (72, 1))
    commanded[:, 5] = np.arange(-180.0, 180.0, 5.0)
    drive(out, commanded, np.ones((72, 6)))
    dataset = out.dataset(tmp_path)
    angle, away = np.radians(commanded[:, 5]), dataset.points - dataset.points.mean(axis=0)
    axis, outward = np.cross(away[0], away[18]), away / np.linalg.norm(away, axis=1, keepdims=True)
    ripple, wobble = RIPPLE * np.cos(3.0 * angle), WOBBLE * np.cos(2.0 * angle)
    moved = ripple[:, None] * outward + wobble[:, None] * axis / np.linalg.norm(axis)
    (sweep,) = analyse(replace(dataset, points=dataset.points + moved))
    np.testing.assert_allclose(sweep.radial, ripple, atol=5.0 * NOISE)
    np.testing.assert_allclose(sweep.axial, wobble, atol=5.0 * NOISE)
    assert sweep.radial_rms == pytest.approx(RIPPLE / np.sqrt(2.0), abs=NOISE)
    assert sweep.axial_rms == pytest.approx(WOBBLE / np.sqrt(2.0), abs=NOISE)
    assert sweep.radial_largest == pytest.approx(RIPPLE, abs=3.0 * NOISE)
    assert sweep.axial_largest == pytest.approx(WOBBLE, abs=3.0 * NOISE)


def test_up_only_has_no_reversal(dataset: Dataset) -> None:
    up = dataset.conditions.side[:, 4] > 0
    sweep = next(s for s in analyse(_take(dataset, up)) if s.joint == 5)
    assert (sweep.reversal, sweep.u_reversal) == (None, None)
    assert sweep.upwards.all()


def _take(dataset: Dataset, rows: np.ndarray) -> Dataset:
    """The data set with the other rows out of the fit."""
    return replace(dataset, status=np.where(rows, "ok", "rejected:test"))


def test_no_sweep_is_refused(tmp_path: Path) -> None:
    plain = Cell()
    plain.measure("p", 40, validation=0)
    with pytest.raises(DataError, match=r'holds no sweep.*kind = "sweep"'):
        analyse(plain.dataset(tmp_path))


def test_readings_from_many_sides_are_no_sweep(dataset: Dataset) -> None:
    """Readings from many sides are no sweep.

    Those with the other joints from the same sides would leave a circle through two points.
    """
    bits = np.arange(len(dataset))[:, None] >> np.arange(6)
    mixed = np.where(bits & 1, 1.0, -1.0)
    with pytest.raises(DataError, match="came from the same sides"):
        analyse(replace(dataset, conditions=replace(dataset.conditions, side=mixed)))


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = cell()
    data = write_files(tmp_path, made.rows, made.header())
    picture = tmp_path / "sweeps.svg"
    assert main(["sweeps", str(data), "--picture", str(picture), "--json", str(tmp_path / "s.json")]) == 0
    shown = capsys.readouterr().out
    assert "Joints one at a time" in shown
    assert "Axes of the circles" in shown
    document = json.loads((tmp_path / "s.json").read_text("utf-8"))
    five = next(s for s in document["sweeps"] if s["joint"] == 5)
    assert five["reversal_deg"] == pytest.approx(GAP[5], abs=4.0 * five["u_reversal_deg"])
    assert five["axial_rms_mm"] == pytest.approx(np.sqrt(np.mean(np.square(five["axial_mm"]))))
    assert "Deviation from the circle, mm" in shown
    assert picture.read_text("utf-8").count("tangential error, deg") == 3


def test_sweeps_alone_have_no_identified_axes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = cell(step=15.0)
    data = write_files(tmp_path, made.rows[60:70], made.header())
    assert main(["sweeps", str(data)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "The axes are given alone" in shown
    assert main(["sweeps", str(tmp_path / "none.csv")]) == 2
