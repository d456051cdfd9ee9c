"""Test the library of effects and its conformance check.

These would catch: an effect whose column is not its derivative, that acts at zero, whose unit or slot does not
exist or that JSON changes. They would also catch an owner with which a correction omits the effect or applies it
wrongly, and a check that passes any of these.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import Robot
from calib.array import Array
from calib.data import GROUPS, Conditions
from calib.effects import LIBRARY, Survey, changes, kind_of, offers
from calib.effects.geometry import tool_shift
from calib.effects.transmission import BANDS, backlash, curve_of, gear_orders, periodic
from calib.model import BoundModel, Effect, base_model, check_effect, regressors
from calib.model.effect import EffectTerm, Parameter
from calib.model.regressors import Constant, JointAngle, Temperature
from calib.scan import Candidate, Family, Harmonics, Shapes, Steps
from calib.units import FACTORS, to_internal
from mocks.world import ROBOTS
from tests.calib.campaigns import situation


def some_effects(offer: Family) -> list[Effect]:
    """List effects of an offer: all of them, or the first, a middle and the last of a scan."""
    if isinstance(offer, Candidate):
        return [offer.effect]
    assert isinstance(offer, Harmonics | Steps | Shapes)
    places = (
        offer.orders
        if isinstance(offer, Harmonics)
        else offer.ranks
        if isinstance(offer, Steps)
        else offer.values
    )
    assert len(places) > 3
    found = [offer.at(float(places[i])) for i in (0, len(places) // 3, len(places) - 1)]
    return [*found, offer.slowly(*offer.stretches[0])] if isinstance(offer, Steps) else found


COMPLIANCE = {k: 1e-7 * k for k in range(2, 7)}


def library(robot: Robot, conditions: Conditions) -> list[Effect]:
    survey = Survey(robot, conditions, compliance=COMPLIANCE)
    return [*(effect for offer in offers(survey) for effect in some_effects(offer)), *changes(survey)]


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_every_effect_of_the_library_conforms(name: str) -> None:
    model, conditions = situation(name)
    effects = library(model.robot, conditions)
    library_kinds = {kind.name for e in LIBRARY for kind in e.KINDS if not kind.name.startswith("slide_")}
    assert {kind_of(each.label).name for each in effects} == library_kinds - {"gear_orders"}
    for effect in effects:
        check_effect(effect, model, conditions)


def test_a_curve_of_gear_orders_conforms() -> None:
    model, conditions = situation("abb-irb120")
    curve = gear_orders(4, np.full(BANDS, 0.01), without=(3, 50))
    check_effect(curve, model, conditions)
    assert len(curve.parameters) == 2 * (100 - 2)
    assert len({p.short for p in curve.parameters}) == len(curve.parameters), "JSON goes by the short names"


def test_a_curve_that_is_held_moves_the_joint_as_the_effect_does() -> None:
    model, conditions = situation("abb-irb120")
    curve = gear_orders(4, np.full(BANDS, 0.01), without=(7,))
    values = np.random.default_rng(1).normal(size=len(curve.parameters)) * 1e-4
    free = BoundModel(replace(model, effects=(curve,)), conditions).predict(values)
    held = BoundModel(replace(model, effects=(), curves=(curve_of(4, curve, values),)), conditions)
    nominal = BoundModel(replace(model, effects=()), conditions).predict(np.zeros(0))
    assert np.abs(held.predict(np.zeros(0)) - nominal).max() > 0.01
    np.testing.assert_allclose(held.predict(np.zeros(0)), free, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_every_group_of_the_base_model_conforms(name: str) -> None:
    model, conditions = situation(name)
    seen = 0
    for group in GROUPS:
        effects = base_model.build(
            (group,), model.robot, ("day", "night"), ({"T1": False, "T2": True}, {"T2": False})
        )
        for effect in effects:
            if group == "compliance" and name.startswith("ur"):
                # gravity never loads the last joint of a UR without a tool: its column is zero
                effect = replace(effect, parameters=effect.parameters[:-1], terms=effect.terms[:-1])
            check_effect(effect, model, conditions)
            seen += 1
    check_effect(base_model.base_targets({"B1": None, "B2": 0.1}), model, conditions)
    assert seen == len(GROUPS) + 3


class TestCheckEffectRefuses:
    """A check proves nothing until it was seen to fail."""

    model, conditions = situation("abb-irb120")
    good = periodic(2, 3.0)

    def refused(self, effect: Effect, word: str) -> None:
        check_effect(self.good, self.model, self.conditions)
        with pytest.raises(AssertionError, match=word):
            check_effect(effect, self.model, self.conditions)

    def test_a_wrong_derivative(self, monkeypatch: pytest.MonkeyPatch) -> None:
        columns = BoundModel.columns

        def wrong(self: BoundModel, *arguments: Any) -> Array:
            return columns(self, *arguments) * 1.0001

        with monkeypatch.context() as patch:
            patch.setattr(BoundModel, "columns", wrong)
            with pytest.raises(AssertionError, match="errs by"):
                check_effect(self.good, self.model, self.conditions)

    def test_acting_at_zero(self, monkeypatch: pytest.MonkeyPatch) -> None:
        values = BoundModel.values

        def stuck(self: BoundModel, estimate: Array) -> Mapping[str, Array | float]:
            out = values(self, estimate)
            if len(estimate):
                out["theta2"] = out["theta2"] + 1e-6
            return out

        with monkeypatch.context() as patch:
            patch.setattr(BoundModel, "values", stuck)
            with pytest.raises(AssertionError, match="although it is zero"):
                check_effect(self.good, self.model, self.conditions)

    def test_a_unit_that_does_not_exist(self) -> None:
        first = replace(self.good.parameters[0], unit="furlong")
        self.refused(replace(self.good, parameters=(first, *self.good.parameters[1:])), "furlong")

    @pytest.mark.parametrize("size", [0.0, -1.0])
    def test_a_size_that_cannot_be(self, size: float) -> None:
        first = replace(self.good.parameters[0], size=size)
        self.refused(replace(self.good, parameters=(first, *self.good.parameters[1:])), "size")

    def test_a_slot_that_does_not_exist(self) -> None:
        wrong = replace(self.good.terms[0], slot="theta7")
        self.refused(replace(self.good, terms=(wrong, *self.good.terms[1:])), "theta7")

    def test_json_that_changes_it(self) -> None:
        @dataclass(frozen=True)
        class Sine(JointAngle):  # the name of a regressor, but not its shape: JSON brings back another one
            order: float = 3.0

        wrong = replace(self.good.terms[1], regressor=Sine(2))
        self.refused(replace(self.good, terms=(self.good.terms[0], wrong)), "JSON changes it")

    def test_parameters_and_terms_that_do_not_name_each_other(self) -> None:
        self.refused(replace(self.good, terms=self.good.terms[:1]), "name each other")
        extra = (*self.good.terms, EffectTerm("nobody", "theta1", 1.0, Constant()))
        self.refused(replace(self.good, terms=extra), "name each other")

    def test_words_that_are_missing(self) -> None:
        self.refused(replace(self.good, label=""), "label")
        self.refused(replace(self.good, label="gear of joint 2"), "spaces")
        self.refused(replace(self.good, meaning="A gear"), "full stop")
        self.refused(replace(self.good, parameters=(), terms=()), "no parameter")

    def test_a_column_that_moves_nothing(self) -> None:
        still = replace(self.conditions, side=np.zeros_like(self.conditions.side))
        with pytest.raises(AssertionError, match="moves nothing"):
            check_effect(backlash(2), self.model, still)


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_effects_survive_json(name: str) -> None:
    model, conditions = situation(name)
    effects = [
        *library(model.robot, conditions),
        *base_model.build(GROUPS, model.robot, ("day", "night"), ({"T1": False}, {"T1": False, "T2": False})),
    ]
    for effect in effects:
        text = json.dumps(effect.to_json(), allow_nan=False)
        assert Effect.from_json(json.loads(text)) == effect


@given(
    kind=st.sampled_from(sorted(regressors.KINDS)),
    joint=st.integers(1, 6),
    number=st.floats(-1e6, 1e6),
    name=st.text(max_size=8),
)
@settings(max_examples=100)
def test_regressors_survive_json(kind: str, joint: int, number: float, name: str) -> None:
    fields = regressors.KINDS[kind].__dataclass_fields__
    shape: dict[str, Any] = {
        "joint": joint,
        "series": name,
        "target": name,
        "anchor": name,
        "axis": joint % 3,
    }
    shape["order"] = joint if kind == "StepAt" else number
    regressor = regressors.KINDS[kind](**{field: shape.get(field, number) for field in fields})
    assert regressors.from_json(json.loads(json.dumps(regressors.to_json(regressor)))) == regressor


def test_sizes_are_in_the_unit_that_is_shown() -> None:
    """Amplitudes are in the displayed unit: 1 deg turns the joint by 1 deg, 1 mm moves by 1 mm."""
    model, conditions = situation("abb-irb120")
    for effect, parameter, expected in (
        (backlash(4), "gap", 0.5 * np.radians(1.0) * conditions.side[:, 3]),
        (tool_shift(10), "x", (conditions.order >= 10).astype(float)),
        (tool_shift(10), "ry", np.radians(1.0) * (conditions.order >= 10)),
    ):
        design = BoundModel(model.append(effect), conditions)
        name = f"{effect.label}.{parameter}"
        unit = next(p.unit for p in effect.parameters if p.name == name)
        estimate = np.zeros(len(effect.parameters))
        estimate[design.model.index[name]] = to_internal(1.0, unit)
        slot = next(t.slot for t in effect.terms if t.parameter == name)
        nominal = BoundModel(model, conditions).values(np.zeros(0)).get(slot, 0.0)
        np.testing.assert_allclose(design.values(estimate)[slot] - nominal, expected, atol=1e-12)


def test_amplitude_and_its_spread() -> None:
    effect = Effect(
        "x", "structure", "robot", "X.", (Parameter("a", "deg"), Parameter("b", "deg"), Parameter("c", "mm")), ()
    )  # fmt: skip
    deg = FACTORS["deg"]
    covariance = np.diag([(0.1 * deg) ** 2, (0.2 * deg) ** 2, 25.0])
    size, spread, unit = effect.amplitude(np.array([3.0 * deg, 4.0 * deg, 7.0]), covariance)
    assert (size, unit) == (pytest.approx(5.0), "deg")
    assert spread == pytest.approx(np.hypot(0.6 * 0.1, 0.8 * 0.2))


def test_two_effects_may_not_share_a_parameter() -> None:
    model, _ = situation("abb-irb120")
    with pytest.raises(ValueError, match="share"):
        _ = model.append(backlash(2), backlash(2)).index


def test_warmer_air_is_a_positive_temperature() -> None:
    conditions = cast(Conditions, SimpleNamespace(temperature=np.array([25.0, 18.0])))
    np.testing.assert_array_equal(Temperature(20.0).evaluate(conditions), [5.0, -2.0])
