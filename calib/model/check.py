"""`check_effect`: the conformance check that every effect must pass, of the library or of another package."""

from __future__ import annotations

import json

import numpy as np

from calib.arm.kinematics import BESIDE, Frames
from calib.data.conditions import Conditions
from calib.model.effect import Effect
from calib.model.model import Design, RobotModel
from calib.model.observations import Observations
from calib.units import FACTORS, to_internal

_DIFFERENCE = 1e-4  # of the expected size: far above rounding, far below curvature
_TOLERANCE = 1e-5


def check_effect(effect: Effect, model: RobotModel, conditions: Conditions) -> None:
    """Check one effect on a model (without it) and some conditions.

    Checked: label, meaning and units are there; it does nothing at zero; its columns are the derivative of the
    exact chain (central differences, relative 1e-5); it survives JSON. Raises AssertionError naming what fails.
    """
    assert effect.label, "the effect has no label"
    assert not any(c.isspace() for c in effect.label), f"{effect.label!r}: a label has no spaces"
    assert effect.meaning.endswith("."), (
        f"{effect.label}: its meaning is one sentence and ends in a full stop"
    )
    assert effect.parameters, f"{effect.label}: it has no parameter"
    for parameter in effect.parameters:
        assert parameter.unit in FACTORS, f"{parameter.name}: unknown unit {parameter.unit!r}"
        assert parameter.size is None or parameter.size > 0.0, (
            f"{parameter.name}: its size must be above zero"
        )
    shown = {parameter.short for parameter in effect.parameters}
    assert effect.group == "base model" or len(shown) == len(effect.parameters), (
        f"{effect.label}: two parameters are shown under one name"
    )
    assert {t.parameter for t in effect.terms} == {p.name for p in effect.parameters}, (
        f"{effect.label}: terms and parameters do not name each other"
    )
    unknown = {t.slot for t in effect.terms} - {*model.chain.slots, *BESIDE}
    assert not unknown, f"{effect.label}: no such slot: {', '.join(sorted(unknown))}"
    assert Effect.from_json(json.loads(json.dumps(effect.to_json()))) == effect, (
        f"{effect.label}: JSON changes it"
    )

    plain = Design(model, conditions)
    extended = Design(model.append(effect), conditions)
    at_zero = np.zeros(len(extended.model.parameters))
    before = plain.predict(at_zero[: len(plain.model.parameters)])
    assert np.array_equal(before, extended.predict(at_zero)), f"{effect.label}: it acts although it is zero"

    frames = extended.frames(at_zero)
    observed = _everything(frames, len(conditions))
    jacobian = extended.columns(observed.columns(frames, extended.slots))
    for position in extended.model.positions(effect):
        parameter = extended.model.parameters[position]
        step = _DIFFERENCE * to_internal(1.0 if parameter.size is None else parameter.size, parameter.unit)
        moved = at_zero.copy()
        moved[position] = step
        ahead, behind = (observed.residual(extended.frames(x)) for x in (moved, -moved))
        difference = (behind - ahead).ravel() / (2.0 * step)
        scale = max(float(np.max(np.abs(difference))), 1e-12)
        error = float(np.max(np.abs(jacobian[:, position] - difference))) / scale
        assert error < _TOLERANCE, f"{parameter.name}: its column errs by {error:.1e} against differences"
        assert scale > 1e-12, f"{parameter.name}: it moves nothing under these conditions"


def _everything(frames: Frames, n: int) -> Observations:
    """Point, orientation and distance of every reading, as the frames have them, with unit weights."""
    points = np.broadcast_to(frames.p, (3, n))
    lengths = np.linalg.norm(points - frames.anchor, axis=0)
    weights = np.broadcast_to(np.eye(7)[:, :, None], (7, 7, n))
    return Observations(points, frames.rotation.transpose(1, 2, 0), lengths, weights, np.full(n, 7))
