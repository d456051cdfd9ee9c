"""The part of a model that can be used for corrections: without carried terms whose conditions only a campaign has.

A function of time is known while the readings are taken, and not afterwards; the last move is not known of a target.
Such terms are left out, and the other parameters adapted to first order (`calib.model.reduced`). The loss is the
distance between both models over random poses within the joint limits, at random times of the campaign:

    loss = |p_whole(q, t) - p_usable(q, t)|
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array import Array
from calib.compensate.calibrated import corrects, in_base
from calib.fit.statistics import ErrorStatistics, distances, statistics_of
from calib.model.carried_regressors import OfTime
from calib.model.effect import Effect
from calib.model.model import Design, RobotModel
from calib.model.reduced import without
from calib.model.stated import StatedConditions, conditions_at

_SAMPLES = 500
_NAMED = 6  # terms named in one line; the document names all
_SECONDS, _AIR_C = 3600.0, 20.0  # for named effects of time and temperature where none is stated


@dataclass(frozen=True)
class Usable:
    """A model for corrections, its estimate (m,) and covariance (m, m) in internal units; left_out: carried terms that
    it lacks; loss: mm, what leaving them out costs, None if nothing was left out."""

    model: RobotModel
    estimate: Array
    covariance: Array
    left_out: tuple[Effect, ...]
    loss: ErrorStatistics | None

    @property
    def in_words(self) -> tuple[str, ...]:
        """What was left out, and its cost, as sentences; empty if nothing was left out."""
        if self.loss is None:
            return ()
        names = ", ".join(effect.label for effect in self.left_out[:_NAMED])
        more = len(self.left_out) - _NAMED
        return (
            f"Carried terms that the correction leaves out: {names}{f' and {more} more' if more > 0 else ''}. Without "
            f"them positions change by {self.loss.rms:.3f} mm RMS, {self.loss.max:.3f} mm at most, at {self.loss.n} "
            "random poses and times of the campaign.",
        )


def usable(
    model: RobotModel,
    estimate: Array,
    covariance: Array,
    stated: StatedConditions,
    *,
    named_only: bool = False,
    coupling: str = "none",
) -> Usable:
    """The model, estimate (m,) and covariance (m, m), without carried terms that cannot be used; named_only: without
    any. stated: loads, gravity and air for the loss."""
    left_out = tuple(e for e in model.effects if e.is_carried and (named_only or not e.is_usable))
    less, values, spread = without(model, estimate, covariance, left_out)
    if not left_out:
        return Usable(less, values, spread, (), None)
    robot, rng, series = model.robot, np.random.default_rng(1), stated.series or next(iter(model.targets))
    joints, before = (
        robot.model_angles(rng.uniform(robot.lower, robot.upper, (_SAMPLES, robot.joints)), coupling)
        for _ in range(2)
    )
    clocks = {"time": (_SECONDS, _SECONDS)} | {
        term.regressor.clock: (term.regressor.times[0], term.regressor.times[-1])
        for effect in left_out
        for term in effect.terms
        if isinstance(term.regressor, OfTime)
    }
    air = _AIR_C if np.isnan(stated.temperature_c) else stated.temperature_c
    conditions = replace(
        conditions_at(model, joints, replace(stated, series=series, temperature_c=air)),
        previous=before,
        **{clock: rng.uniform(*ends, _SAMPLES) for clock, ends in clocks.items()},
    )
    whole, part = (
        Design(in_base(each), conditions).predict(x * corrects(each, series))
        for each, x in ((model, estimate), (less, values))
    )
    return Usable(less, values, spread, left_out, statistics_of(distances(whole, part)))
