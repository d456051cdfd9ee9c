"""Test points, poses and distances as whitened rows.

These would catch: a residual or a column that differs from the instrument's reading, a covariance that is assembled
wrongly, rows that count without being measured, and a column that is not the derivative of the residual.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib import load_robot
from calib.arm.kinematics import ANCHOR, FRAME, LENGTH_ZERO
from calib.data.noise import whitener
from calib.model import BoundModel, ModelStructure, effect
from calib.model.observations import Observations
from calib.model.regressors import Constant
from tests.calib.campaigns import conditions_of
from tests.calib.cells import POSE
from tests.calib.chain import chain

Array = NDArray[np.float64]


class Situation:
    """Model with one parameter on every slot, away from nominal, and incomplete readings.

    Each reading lacks some number.
    """

    def __init__(self, name: str, seed: int = 3, n: int = 12) -> None:
        rng = np.random.default_rng(seed)
        robot = load_robot(name)
        self.n = n
        self.conditions = conditions_of(robot, rng.uniform(-2.0, 2.0, (n, robot.joints)), seed)
        anchors = {"B1": (900.0, 100.0, 0.0), "B2": (-400.0, 800.0, 50.0)}
        targets = {"T1": (0.0, 0.0, 125.0), "T2": (75.0, 93.0, 215.0)}
        bare = ModelStructure(
            robot,
            (),
            {"day": targets, "night": targets},
            {"night": POSE},
            (2400.0, -900.0, 350.0),
            {"day": Rotation.from_rotvec([0.4, 0.2, -0.3]).as_matrix()},
            anchors,
        )
        self.slots = (*bare.chain.slots, *ANCHOR, LENGTH_ZERO)
        acts = {f"p{i}": ("", None, [(slot, Constant())]) for i, slot in enumerate(self.slots)}
        self.model = replace(bare, effects=(effect("all", "base model", "robot", "Everything moves.", acts),))
        self.estimate = rng.uniform(-0.1, 0.1, len(self.slots))
        self.design = BoundModel(self.model, self.conditions)
        frames = self.design.frames(self.estimate)
        off = Rotation.from_rotvec(rng.uniform(-1.6, 1.6, (n, 3))).as_matrix()  # up to 2.8 rad off
        off[0] = np.eye(3)
        measured = np.ones((n, 7), dtype=bool)
        measured[1, :3] = measured[2, 3:6] = measured[3, 6] = measured[4, :6] = measured[5, 3:] = False
        root = rng.normal(size=(n, 7, 7)) + 3.0 * np.eye(7)
        self.covariance = root @ root.transpose(0, 2, 1)
        self.measured = measured
        self.observed = Observations(
            frames.p + rng.normal(size=(3, n)),
            (off @ frames.rotation).transpose(1, 2, 0),
            rng.uniform(300.0, 1500.0, n),
            whitener(self.covariance, measured),
            measured.sum(axis=1),
        )

    def residual(self, estimate: Array) -> Array:
        return self.observed.residual(self.design.frames(estimate))


@pytest.mark.parametrize("name", ["abb-irb120", "ur10"])
class TestRows:
    def test_residuals_are_those_of_plain_matrices(self, name: str) -> None:
        """Residuals are measured less predicted, whitened by the covariance of the measured part."""
        s = Situation(name)
        got = s.residual(s.estimate).T
        add = dict(zip(s.slots, s.estimate, strict=True))
        c, observed = s.conditions, s.observed
        for i in range(s.n):
            series, target = c.series_names[c.series[i]], c.target_names[c.target[i]]
            place = s.model.placements.get(series, np.eye(4))
            turn = np.eye(4)
            turn[:3, :3] = s.model.turns.get(series, np.eye(3))
            # the frame's motion stands before the placement, the turn of the tool before the target's own
            only = {k: v for k, v in add.items() if k.startswith("frame")}
            still = load_robot(name)
            frame = chain(still, c.joints[i], only, station=s.model.station).real
            frame = frame @ np.linalg.inv(chain(still, c.joints[i], {}).real)
            inner = {k: v for k, v in add.items() if not k.startswith(("frame", "target.r"))}
            tip = chain(still, c.joints[i], inner, s.model.targets[series][target]).real
            spin = np.eye(4)
            spin[:3, :3] = Rotation.from_euler("XYZ", [add[f"target.r{k}"] for k in "xyz"]).as_matrix()
            pose = frame @ place @ tip @ turn @ spin
            base = np.array(s.model.anchors[c.anchor_names[c.anchor[i]]]) + [add[k] for k in ANCHOR]
            base = frame[:3, :3] @ base + frame[:3, 3]
            assert observed.points is not None
            assert observed.rotations is not None
            assert observed.lengths is not None
            raw = np.concatenate(
                [
                    observed.points[:, i] - pose[:3, 3],
                    Rotation.from_matrix(observed.rotations[:, :, i] @ pose[:3, :3].T).as_rotvec(),
                    [observed.lengths[i] - np.linalg.norm(pose[:3, 3] - base) - add[LENGTH_ZERO]],
                ]
            )
            seen = s.measured[i]
            lower = np.linalg.cholesky(s.covariance[i][np.ix_(seen, seen)])
            np.testing.assert_allclose(got[i, seen], np.linalg.solve(lower, raw[seen]), rtol=0, atol=1e-8)
            assert not got[i, ~seen].any()

    def test_columns_are_derivatives(self, name: str) -> None:
        """Columns agree with central differences of the residual for every slot.

        The orientations are up to 2.8 rad off.
        """
        s = Situation(name)
        columns = s.observed.columns(s.design.frames(s.estimate), s.slots)
        assert columns.shape == (len(s.slots), 7, s.n)
        for i, slot in enumerate(s.slots):
            step = np.zeros(len(s.slots))
            step[i] = 1e-5
            ahead, behind = s.residual(s.estimate + step), s.residual(s.estimate - step)
            np.testing.assert_allclose(
                columns[i], (behind - ahead) / 2e-5, rtol=1e-6, atol=2e-6, err_msg=slot
            )
            np.testing.assert_array_equal(
                s.observed.column(s.design.frames(s.estimate), slot), columns[i], err_msg=slot
            )

    def test_a_moved_tool_point_moves_points_and_lengths_alone(self, name: str) -> None:
        s = Situation(name)
        frames = s.design.frames(s.estimate)
        shift = np.random.default_rng(1).normal(size=(3, s.n))
        moved = replace(frames, p=frames.p + 1e-5 * shift)
        change = (s.observed.residual(frames) - s.observed.residual(moved)) / 1e-5
        np.testing.assert_allclose(s.observed.displaced(frames, shift[None])[0], change, rtol=1e-6, atol=2e-6)

    def test_some_of_the_readings(self, name: str) -> None:
        s = Situation(name)
        keep = np.array([7, 1, 4])
        few = s.observed.take(keep)
        frames = BoundModel(s.model, s.conditions.take(keep)).frames(s.estimate)
        np.testing.assert_allclose(few.residual(frames), s.residual(s.estimate)[:, keep], atol=1e-9)
        assert (few.count, few.size, s.observed.count) == (7 + 4 + 1, 21, 7 * 12 - 3 - 3 - 1 - 6 - 4)


def test_lengths_do_not_feel_the_frame_of_the_instrument() -> None:
    """It carries robot and base targets together."""
    s = Situation("abb-irb120")
    lengths = replace(
        s.observed, points=None, rotations=None, whiten=np.ones((1, 1, s.n)), freedom=np.ones(s.n)
    )
    columns = lengths.columns(s.design.frames(s.estimate), [motion.slot for motion in FRAME])
    assert not columns.any()
