"""Effects that a calibration left unresolved: they may exist without being detected.

A diagnosis names the effects that are significant. A smaller one is not absent: an arm has some backlash in every
joint, and fifty readings do not show 0.003 deg of it. A later watch may show it, and must not take it for new. Let X be
the whitened columns of the model at its readings, B those of the effects, and S their usual sizes. With C the
covariance of the model's parameters and s the noise of the fit,

    D = ((B'B - B'X C X'B / s^2) / s^2 + S^-2)^-1,    G = C X'B / s^2:

D is the covariance of the unresolved effects about d = D B'r / s^2, with r the residual. G is the change of the model's
parameters per unit of an effect. A prediction elsewhere is off by X e + (B - X G) b, e ~ C, b ~ N(d, D). The model
corrects without d, which is not claimed; a watch compares with it. Effects of the air are unresolved too, because each
watch has another air temperature. Waves of one and of two cycles per turn are no scatter and are also unresolved: ten
poses see stretches of them. A target turns with its joint, so that A cos q moves it alike at every pose, seen from the
joint before, as a lost zero of that joint would. All other errors of the model are kept as a scatter of the joints.

Source: Kennedy and O'Hagan 2001 (the error of a model is one more unknown).

**Scatter of the joints.** The scatter of each joint that a model does not explain is estimated from its residuals.
A missing law, such as a wave of a gear, moves the joints of a pose alike in every reading there. In ten poses with
three targets each it is drawn ten times, not in ninety rows, and the parameters absorb most of it. Small gears have
larger errors than large ones, and a wrist that is off by ten times as much moves the tool no farther. Every joint
therefore has a separate scatter. Let r be the whitened residual, and Z the columns of all that was estimated or is
unresolved, with P the covariance of their priors. With W_k the columns of joint k in every pose,

    r ~ N(0, H^-1 + sum s_k^2 W_k W_k'),    H = (I + Z P Z')^-1,

and for one joint, with the others in H and W'H W = U a U',

    2 log L(s) = sum s^2 (u'W'H r)^2 / (1 + s^2 a) - log(1 + s^2 a).

The result is the mean of s^2, weighted by L and by the usual errors of gears. It is computed joint by joint with the
others fixed, in a few sweeps. Source: Patterson and Thompson 1971 (restricted likelihood).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.effects import Survey, compliance_of, unclaimed
from calib.errors import DataError
from calib.fit.identification import IdentificationFit
from calib.fit.readings import FitReadings, linearised
from calib.model.effect import Effect, effect
from calib.model.model import ModelStructure
from calib.model.regressors import Constant
from calib.saved.model_checks import numbers_of, refuse_effects
from calib.units import DEG

_PREFIX = "open"
KEY = "left_open"
_USUAL = 0.02 * DEG  # scatter of joints whose gears are as usual: half-normal
_TRIED = np.linspace(0.0, 4.0 * _USUAL, 401)
_POSES = 60  # 200 poses change a joint by about 15 %, and cost ten times as much
_SWEEPS = 3  # over all joints; twenty change one by 8 % at most


@dataclass(frozen=True)
class LeftOpen:
    """Unresolved effects of a calibration, with k parameters that its model does not include.

    Attributes
    ----------
    estimate, covariance, taken_on : array of shape (k,), (k, k) and (m, k)
        d, D and G of the module's equations, internal units.
    scatter : array of shape (N,) or None
        Unmodelled scatter of every joint, rad. None in files that do not state it.
    poses : float or None
        Number of poses from which the scatter was estimated. None in files that do not state it.
    """

    effects: tuple[Effect, ...]
    estimate: Array
    covariance: Array
    taken_on: Array
    scatter: Array | None = None
    poses: float | None = None

    @classmethod
    def of(cls, found: IdentificationFit, held_out: FitReadings | None = None) -> LeftOpen:
        """Find the effects that can set in between two campaigns and that a fit left unresolved.

        Parameters
        ----------
        held_out : FitReadings, optional
            Readings that the fit had not used. With the others they determine the scatter of the joints, because they
            show the part of the model error that the fit absorbed elsewhere.
        """
        model, m = found.model, len(found.estimate)
        survey = Survey(
            robot=model.robot,
            conditions=found.readings.conditions,
            compliance=compliance_of(model, found.estimate),
            loads=found.header.loads,
            station=model.station,
            curves=frozenset(curve.joint for curve in model.curves),
        )
        had = {effect.label for effect in model.effects}
        effects = tuple(effect for effect in unclaimed(survey) if effect.label not in had)
        beside = model.append(*(effect.apart(_PREFIX) for effect in effects))
        k, size = len(beside.prior_std) - m, beside.prior_std[m:]
        every = (found.readings,) if held_out is None else (found.readings, held_out)
        (gram, along), *more = Scattering(beside, found.estimate, every).shown()
        noise = max(found.noise_scale, 1.0) ** 2
        taken_on = found.covariance @ gram[:m, m : m + k] / noise
        left = _left((gram[m : m + k, m : m + k] - gram[m : m + k, :m] @ taken_on) / noise, size)
        estimate, known = left @ along[m : m + k] / noise, found.covariance / noise
        along = np.concatenate([np.zeros(m), along[m:]])  # the fit has ended: its prior pulls as much
        for seen, off in more:
            gram, along, known = (
                gram + seen,
                along + off,
                np.linalg.solve(np.eye(m) + known @ seen[:m, :m], known),
            )
        beyond = gram[m:, m:] - gram[m:, :m] @ known @ gram[:m, m:]
        along = along[m:] - gram[m:, :m] @ known @ along[:m]
        explains = beyond[k:, :k] @ _left(beyond[:k, :k], size)
        scatter = likely_scatter(
            beyond[k:, k:] - explains @ beyond[:k, k:], along[k:] - explains @ along[:k], model.robot.joints
        )
        poses = len(np.unique(found.readings.conditions.pose))
        return cls(effects, estimate, left, taken_on, scatter, poses)

    def beside(
        self, model: ModelStructure, estimate: Array, covariance: Array
    ) -> tuple[ModelStructure, Array, Array]:
        """Add the unresolved effects to a model.

        Returns model, estimate (m + k,) and covariance (m + k, m + k).
        """
        m, k = len(estimate), len(self.estimate)
        carried = np.zeros((m + k, k))
        carried[: len(self.taken_on)] = -self.taken_on
        carried[m:] = np.eye(k)
        whole = carried @ self.covariance @ carried.T
        whole[:m, :m] += covariance
        return (
            model.append(*(effect.apart(_PREFIX) for effect in self.effects)),
            np.concatenate([estimate, np.zeros(k)]) + carried @ self.estimate,
            whole,
        )

    def to_json(self) -> dict[str, Any]:
        """Return a plain dictionary that `from_json` reads back."""
        return {
            "effects": [effect.to_json() for effect in self.effects],
            "estimate_internal_units": _digits(self.estimate),
            "covariance_internal_units": [_digits(row) for row in self.covariance],
            "taken_on_internal_units": [_digits(row) for row in self.taken_on],
            "scatter_rad": None if self.scatter is None else _digits(self.scatter),
            "poses": self.poses,
        }

    @classmethod
    def from_json(cls, table: Mapping[str, Any], model: ModelStructure, path: Path) -> LeftOpen:
        """Read the effects that `to_json` wrote; the model may have got more parameters since.

        Raises
        ------
        DataError
            A value is invalid.
        KeyError
            A key is missing.
        """
        effects = tuple(Effect.from_json(entry) for entry in table["effects"])
        refuse_effects(ModelStructure(model.robot, effects, model.targets, anchors=model.anchors), path)
        k, taken_on = sum(len(effect.parameters) for effect in effects), table["taken_on_internal_units"]
        rows = len(taken_on)
        if not 0 < rows <= len(model.parameters):
            raise DataError(
                "has more parameters than the model.", do="Write the model again.", file=path, key=KEY
            )
        covariance = numbers_of(table["covariance_internal_units"], (k, k), f"{KEY}.covariance", path)
        spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        if np.any(np.abs(covariance) > 1.001 * np.outer(spread, spread) + 1e-30):
            raise DataError(
                "is not a covariance matrix.", do="Write the model again.", file=path, key=f"{KEY}.covariance"
            )
        return cls(
            effects,
            numbers_of(table["estimate_internal_units"], (k,), f"{KEY}.estimate", path),
            covariance,
            numbers_of(taken_on, (rows, k), f"{KEY}.taken_on", path),
            _known(table, "scatter_rad", (model.robot.joints,), path),
            None if (poses := _known(table, "poses", (), path)) is None else float(poses),
        )


def _known(table: Mapping[str, Any], key: str, shape: tuple[int, ...], path: Path) -> Array | None:
    return None if table.get(key) is None else numbers_of(table[key], shape, f"{KEY}.{key}", path)


def _left(shown: Array, size: Array) -> Array:
    """Compute the covariance (k, k) of parameters from usual sizes (k,) and information (k, k).

    The information may be zero.
    """
    values, vectors = np.linalg.eigh(size[:, None] * shown * size)
    root = size[:, None] * vectors / np.sqrt(1.0 + np.maximum(values, 0.0))
    return root @ root.T


def _digits(values: Array) -> list[float]:
    return [float(f"{x:.10g}") for x in values.tolist()]


class Scattering:
    """Independent errors of the joints in every pose, added to the m parameters of a model."""

    def __init__(self, model: ModelStructure, estimate: Array, every: Sequence[FitReadings]) -> None:
        """Prepare the equations at an estimate (m,), or its beginning with the rest 0.

        The sets of readings in `every` have no pose in common.
        """
        robot = model.robot
        acts = {
            f"j{k}": ("", None, [(slot, Constant())]) for k, slot in enumerate(robot.joint_slots, start=1)
        }
        self._model = model.append(effect("scatter", "transmission", "robot", "The joints scatter.", acts))
        self._estimate = np.zeros(len(self._model.parameters))
        self._estimate[: len(estimate)] = estimate
        poses = [readings.conditions.pose for readings in every]
        first = np.cumsum([0, *(int(pose.max()) + 1 for pose in poses)])
        self._sets = [(readings, pose + at) for readings, pose, at in zip(every, poses, first, strict=False)]
        known = np.unique(np.concatenate([pose for _, pose in self._sets]))
        self._poses = known[np.unique(np.linspace(0, len(known) - 1, _POSES).astype(np.int64))]

    def shown(self) -> list[tuple[Array, Array]]:
        """Compute the normal equations of every set, (m + w, m + w) and (m + w,).

        Here w is the number of joints times the number of poses. A sliding joint scatters as many mm as other joints
        deg.
        """
        return [self._shown(readings, pose) for readings, pose in self._sets]

    def _shown(self, readings: FitReadings, pose: NDArray[np.int64]) -> tuple[Array, Array]:
        steps, grams, alongs = self._model.robot.steps, [], []
        for part, residual, columns in linearised(self._model, readings, self._estimate):
            mine = np.tile(pose[part], len(residual))[:, None] == self._poses
            joints = columns[:, -len(steps) :] * steps
            apart = (mine[:, :, None] * joints[:, None, :]).reshape(len(columns), -1)
            every = np.column_stack([columns[:, : -len(steps)], apart])
            grams.append(every.T @ every)
            alongs.append(every.T @ residual.ravel())
        return np.sum(grams, axis=0), np.sum(alongs, axis=0)


def likely_scatter(shown: Array, along: Array, joints: int) -> Array:
    """Estimate the scatter (N,) of every joint, rad, from W'H W (w, w) and W'H r (w,), by pose."""
    joint = np.arange(len(along)) % joints
    scatter = np.full(joints, _likely(shown, along))
    for _ in range(_SWEEPS):
        for k in range(joints):
            mine, others = joint == k, joint != k
            root = scatter[joint[others]]
            both = shown[np.ix_(mine, others)] * root
            rest = np.eye(len(root)) + root[:, None] * shown[np.ix_(others, others)] * root
            taken = np.linalg.solve(rest, np.column_stack([both.T, root * along[others]]))
            scatter[k] = _likely(
                shown[np.ix_(mine, mine)] - both @ taken[:, :-1], along[mine] - both @ taken[:, -1]
            )
    return scatter


def _likely(shown: Array, along: Array) -> float:
    values, vectors = np.linalg.eigh(shown)
    values, square = np.maximum(values, 0.0)[:, None], ((vectors.T @ along) ** 2)[:, None]
    share = _TRIED**2 / (1.0 + _TRIED**2 * values)
    twice = np.sum(square * share - np.log1p(_TRIED**2 * values), axis=0) - (_TRIED / _USUAL) ** 2
    weight = np.exp(0.5 * (twice - twice.max()))
    return float(np.sqrt(weight @ _TRIED**2 / weight.sum()))
