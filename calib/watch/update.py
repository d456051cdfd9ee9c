"""The update of a baseline: the parameters of one cause change, everything else stays.

With e ~ P the error of the baseline and r = A x + J e + ... (`calib.watch.seen`), the estimate of x is that of a least
squares in which e is noise; so

    cov(x) = N = (A' C^-1 A + S^-2)^-1,      cov(e, x) = -P J' C^-1 A N,

and predictions at the poses of the watch are as sure as its readings, whatever the baseline did not know there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.errors import DataError
from calib.model.model import RobotModel
from calib.saved import SavedModel
from calib.watch.cause import Cause
from calib.watch.judge import Verdict
from calib.watch.seen import Seen

_PASSING = ("arm_growth", "drift_translation", "drift_rotation")
"""Causes that are gone when the robot is as warm as it was, or the instrument is."""


def updated(saved: SavedModel, seen: Seen, cause: Cause) -> tuple[RobotModel, Array, Array]:
    """Model, estimate (m,) and covariance (m, m) with a change, internal units. What the model has already under the
    label of the cause is changed, else the effect is appended."""
    effect = next(e for e in seen.causes if e.label == cause.label)
    model, old = saved.model, len(saved.estimate)
    if any(p.name in model.index for p in effect.parameters):
        goal, place = model, [model.index[p.name] for p in effect.parameters]
    else:
        goal, place = model.append(effect), list(range(old, old + len(effect.parameters)))
    estimate = np.concatenate([saved.estimate, np.zeros(len(goal.parameters) - old)])
    estimate[place] += cause.values
    columns = seen.columns[seen.causes.index(effect)]
    change = Change(np.asarray(np.linalg.solve(seen.spread(), columns), dtype=np.float64), cause.covariance)
    return goal, estimate, change.covariance_of(saved, seen, place, len(estimate))


@dataclass(frozen=True)
class Change:
    """A change x of some parameters as readings see it: C^-1 A (q, p), and its covariance N (p, p), internal units."""

    weighed: Array
    normal: Array

    @classmethod
    def of(cls, seen: Seen, columns: Array, prior: Array) -> Change:
        """The change along columns (q, p), whitened by noise; prior (p,): usual sizes of the parameters."""
        weighed: Array = np.asarray(np.linalg.solve(seen.spread(), columns), dtype=np.float64)
        information = columns.T @ weighed + np.diag(prior**-2.0)
        return cls(weighed, np.asarray(np.linalg.inv(information), dtype=np.float64))

    def estimate(self, residual: Array) -> Array:
        """The change (p,) that a whitened residual (q,) shows, internal units."""
        return self.normal @ (self.weighed.T @ residual)

    def covariance_of(self, saved: SavedModel, seen: Seen, place: Sequence[int], size: int) -> Array:
        """(size, size) covariance of the estimate once the change is added at some places of it."""
        old = len(saved.estimate)
        # not what the instrument did with time in its own campaign
        acts = np.flatnonzero(np.diag(seen.covariance)[:old] > 0.0)
        shared = -saved.covariance[:, acts] @ seen.of_parameters[:, acts].T @ self.weighed @ self.normal
        into = np.zeros((size, old + len(place)))
        into[:old, :old] = np.eye(old)
        into[place, old + np.arange(len(place))] += 1.0
        joint = np.block([[saved.covariance, shared], [shared.T, self.normal]])
        return into @ joint @ into.T


def cause_to_update(verdict: Verdict) -> Cause:
    """The cause by which a model may be updated: one that is named alone, or the likeliest of those that no poses tell
    apart, since they move the robot alike. Raises DataError for another verdict."""
    if verdict.kind == "unchanged":
        raise DataError(
            "nothing has changed: there is nothing to update.", do="Go on with the model.", file="--update"
        )
    if verdict.kind == "unexplained":
        raise DataError(
            "what has changed is not known: no parameter can be updated.", do="Recalibrate.", file="--update"
        )
    if (likeliest := verdict.causes[0][0]).label.partition(":")[0] in _PASSING:
        raise DataError(
            f"the cause is {likeliest.label}, which passes: it is no property of the robot.",
            do=likeliest.remedy,
            file="--update",
        )
    if verdict.apart:
        names = ", ".join(cause.label for cause, _ in verdict.causes)
        raise DataError(
            f"the cause is one of {names}, which move the robot differently elsewhere.",
            do="Measure again with more poses, or recalibrate.",
            file="--update",
        )
    return verdict.causes[0][0]
