"""Test the offers of the library for given readings.

These would catch: an offer that depends on data that was not recorded or cannot act, a kind or a joint that is left
out, and a parameter of the base model that is offered a second time. They would also catch a shape constant that
follows the readings instead of staying with the effect.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import Robot, identify
from calib.arm import Load
from calib.data import Conditions
from calib.effects import Survey, offers
from calib.effects.elasticity import joint_compliance
from calib.model import BoundModel, Effect
from calib.scan import Candidate
from calib.units import to_internal
from mocks.world import ROBOTS
from tests.calib.campaigns import simulate, situation


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_every_joint_and_target_has_its_offers(name: str) -> None:
    model, conditions = situation(name)
    counted = Counter(offer.label.partition(":")[0] for offer in offers(Survey(model.robot, conditions)))
    # gravity never loads joint 1 of a robot that stands upright, nor joint 6 of a UR without a tool
    loaded = 4 if name.startswith("ur") else 5
    per_joint = dict.fromkeys(
        (
            "periodic",
            "backlash",
            "lost_motion",
            "joint_step",
            "settling",
            "encoder_scale",
            "coupling",
            "thermal_joint",
            "link_torsion",
            "bearing_tilt",
        ),
        6,
    )
    per_load = dict.fromkeys(("joint_compliance", "dead_zone", "cubic_stiffness", "backlash_load"), loaded)
    single = dict.fromkeys(
        ("pedestal", "tool_offset", "tool_tilt", "base_shift", "tool_shift", "drift_translation",
         "drift_rotation", "tracker_scale", "thermal_growth", "warm_up"), 1
    )  # fmt: skip
    assert counted == {
        **per_joint, **per_load, **single, "joint_offset": 5, "target_offset": 2, "base_target_shift": 2,
        "parallel_twist": len(model.robot.parallel_axes),
    }  # fmt: skip


def test_an_offer_needs_what_it_is_driven_by() -> None:
    model, conditions = situation("abb-irb120")
    n = len(conditions)

    def names(**changed: Any) -> set[str]:
        survey = Survey(model.robot, replace(conditions, **changed))
        return {offer.label for offer in offers(survey)}

    complete = names()
    of_time = {"drift_translation", "drift_rotation", "warm_up"}
    of_moments = {"base_shift", "tool_shift", *(f"joint_step:j{k}" for k in range(1, 7))}
    assert complete - names(time=np.full(n, np.nan)) == of_time | of_moments
    assert complete - names(time=np.full(n, 60.0)) == of_time
    assert complete - names(time=conditions.time / 10.0) == {"warm_up"}, "a session of 80 s warms nothing up"
    of_temperature = {"thermal_growth", *(f"thermal_joint:j{k}" for k in range(1, 7))}
    assert complete - names(temperature=np.full(n, np.nan)) == of_temperature
    assert complete - names(temperature=np.full(n, 21.3)) == of_temperature
    one = conditions.side.copy()
    one[:, 3] = 1.0
    assert complete - names(side=one) == {"backlash:j4", "backlash_load:j4", "lost_motion:j4"}
    still = conditions.joints.copy()
    still[:, 1] = 0.7
    of_motion = ("encoder_scale", "periodic", "backlash", "lost_motion", "settling", "joint_step", "joint_offset",
                 "joint_compliance", "dead_zone", "cubic_stiffness", "thermal_joint", "backlash_load", "bearing_tilt",
                 "link_torsion")  # fmt: skip
    assert complete - names(joints=still) == {"coupling:j2-j3", *(f"{name}:j2" for name in of_motion)}
    assert complete - names(previous=conditions.joints) == {f"settling:j{k}" for k in range(1, 7)}
    torque = conditions.torque.copy()
    torque[:, 4] *= 10.0 / np.abs(torque[:, 4]).max()
    of_load = {"joint_compliance:j5", "dead_zone:j5", "cubic_stiffness:j5", "backlash_load:j5"}
    assert complete - names(torque=torque) == of_load, "10 N.mm bend nothing"
    torque[:, 4] = 1000.0 + np.arange(n)
    assert complete - names(torque=torque) == {"dead_zone:j5"}, "a gap that never closes the other way"
    light = conditions.moment * 1e-4
    assert complete - names(moment=light) == {
        f"{name}:j{k}" for name in ("link_torsion", "bearing_tilt") for k in range(1, 7)
    }
    assert complete - names(overturning=0.0 * conditions.overturning) == {"pedestal"}
    assert complete - names(point=0.0 * conditions.point) == {"tracker_scale"}
    assert complete - names(target=0 * conditions.target) == {"target_offset:T2"}


def test_what_the_base_model_has_is_not_offered_again(tmp_path: Path) -> None:
    def names(*groups: str) -> set[str]:
        _, data = simulate(tmp_path / groups[-1], seed=5, n=60, n_validation=0, effects=[], fit=groups)
        fitted = identify(data)
        return {offer.label for offer in offers(Survey.of(fitted, data))}

    def of(name: str, *joints: int) -> set[str]:
        return {f"{name}:j{k}" for k in joints}

    level_3 = names("base", "geometry", "parallel_twist", "compliance")
    payload, tool = {"payload_mass", "payload_cog"}, {"tool_offset", "tool_tilt"}
    targets = {f"target_offset:T{k}" for k in (1, 2, 3)}
    offsets, twists = of("joint_offset", *range(2, 7)), of("parallel_twist", 3)
    compliances, scales = of("joint_compliance", *range(2, 7)), of("encoder_scale", *range(1, 7))
    assert payload | tool | targets | scales < level_3
    assert not level_3 & (offsets | twists | compliances)
    assert names("base", "geometry", "compliance") - level_3 == twists
    level_2 = names("base", "geometry", "parallel_twist")
    assert (level_2 - level_3, level_3 - level_2) == (compliances, payload)
    level_1 = names("base", "joint_offsets", "encoder_scale")
    assert (level_1 - level_3, level_3 - level_1) == (twists | compliances, payload | scales)
    assert level_3 - names("base", "geometry", "parallel_twist", "compliance", "tool") == tool | targets


def test_the_survey_knows_compliances_and_loads(tmp_path: Path) -> None:
    """A payload effect multiplies estimated compliances, in rad/(N.mm).

    They come from the base model and from a compliance found since.
    """
    campaign, data = simulate(
        tmp_path, seed=5, n=60, n_validation=0, effects=[], tool_mass_kg=1.5, tool_cog_mm=(10.0, 20.0, 80.0)
    )
    fitted = identify(data)
    survey = Survey.of(fitted, data)
    assert survey.compliance == {
        k: pytest.approx(fitted.estimate[fitted.model.index[f"c{k}"]]) for k in range(2, 7)
    }
    for k in (2, 3, 4):
        assert survey.compliance[k] == pytest.approx(campaign.world.compliance[k - 1], rel=0.1)
    assert survey.payload == Load(6, 1.5, (10.0, 20.0, 80.0))
    assert survey.station == tuple(data.header.noise.station_mm)
    once_more = replace(
        fitted, model=fitted.model.append(joint_compliance(3)), estimate=np.append(fitted.estimate, 1e-7)
    )
    assert Survey.of(once_more, data).compliance[3] == pytest.approx(survey.compliance[3] + 1e-7)
    bare = replace(survey, loads=(Load(2, 4.2, (140.0, 0.0, 0.0)),))
    assert bare.payload is None
    labels = {offer.label for offer in offers(bare)}
    assert "payload_mass" in labels, "a tool that nobody declared"
    assert "payload_cog" not in labels


def test_a_target_of_two_series_is_one_target() -> None:
    """Shifted in every series that measured it, and in no other reading."""
    model, conditions = situation("abb-irb120")
    offer = next(o for o in offers(Survey(model.robot, conditions)) if o.label == "target_offset:T2")
    assert isinstance(offer, Candidate)
    extended = model.append(offer.effect)
    moved = BoundModel(extended, conditions).predict(np.array([0.3, 0.0, -0.4]))
    way = np.linalg.norm(moved - BoundModel(model, conditions).predict(np.zeros(0)), axis=1)
    assert len(np.unique(conditions.series)) == 2
    np.testing.assert_allclose(way, 0.5 * (conditions.target == 1), atol=1e-9)


def test_shapes_stay_what_they_were_at_other_readings() -> None:
    """Shape constants of an effect do not change with the readings.

    Examples are the width of a dead zone and the mean temperature.
    """
    model, conditions = situation("abb-irb120")
    few = conditions.take(np.arange(5))
    for label in ("dead_zone:j2", "thermal_joint:j3", "thermal_growth", "cubic_stiffness:j2"):
        offer = next(o for o in offers(Survey(model.robot, conditions)) if o.label == label)
        assert isinstance(offer, Candidate)
        saved = Effect.from_json(json.loads(json.dumps(offer.effect.to_json())))
        estimate = np.array([to_internal(p.size or 0.0, p.unit) for p in saved.parameters])
        all_of_them = BoundModel(model.append(offer.effect), conditions).predict(estimate)
        np.testing.assert_array_equal(BoundModel(model.append(saved), few).predict(estimate), all_of_them[:5])
    width = dead_zone_width(model.robot, conditions)
    assert width == pytest.approx(0.05 * np.abs(conditions.torque[:, 1]).max())
    assert dead_zone_width(model.robot, few) < width


def dead_zone_width(robot: Robot, conditions: Conditions) -> float:
    offer = next(o for o in offers(Survey(robot, conditions)) if o.label == "dead_zone:j2")
    assert isinstance(offer, Candidate)
    return offer.effect.shape["width_nmm"]
