"""Test that a made-up effect needs one file and one line of the library.

Diagnosis, follow-up and advice use it without further changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calib import Dataset, effects, identify, load_robot
from calib.diagnose import diagnose, later_visits, separating
from calib.diagnose.select import refine, refit
from calib.effects import LIBRARY, EffectKind, Survey, check_of, offers
from calib.effects.thermal import warm_up
from calib.model import BoundModel, Effect, check_effect, effect
from calib.model.regressors import ApproachSide, Cosine, Sine
from calib.scan import Candidate, Harmonics, Scores, Space
from calib.scan.scores import FamilyScores
from calib.units import DEG
from tests.calib.campaigns import simulate

LABEL = "leaning_axis:j3"
CHECK = "Push the arm across axis 3 and read a dial gauge."
APART = "lean on the arm while it is measured."


def leaning_axis(joint: int) -> Effect:
    """The axis of a joint leans to the side from which it comes; parameter lean, deg."""
    acts = {"lean": ("deg", 0.1, [(f"alpha{joint}", ApproachSide(joint))])}
    return effect(f"leaning_axis:j{joint}", "structure", "robot", f"Axis {joint} leans with its side.", acts)


def offer(survey: Survey) -> list[Candidate]:
    """One, of joint 3."""
    return [Candidate(leaning_axis(3))]


FILE = SimpleNamespace(
    KINDS=(EffectKind("leaning_axis", "Push the arm across axis {joint} and read a dial gauge.", (APART,)),),
    offer=offer,
)


@pytest.fixture
def leaning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Dataset:
    """A campaign of a robot of which axis 3 leans by 0.03 deg; the library has the line."""
    monkeypatch.setattr(effects, "LIBRARY", (*LIBRARY, FILE))
    _, data = simulate(tmp_path, seed=5, n=120, n_validation=0, effects=[])
    fitted = identify(data)
    design = BoundModel(fitted.model.append(leaning_axis(3)), data.conditions)
    none, some = np.append(fitted.estimate, 0.0), np.append(fitted.estimate, 0.03 * DEG)
    return replace(data, points=data.points + design.predict(some) - design.predict(none))


def test_a_made_up_effect_is_found_and_checked(leaning: Dataset) -> None:
    found = diagnose(leaning).effects
    assert [each.effect.label for each in found] == [LABEL]
    assert check_of(LABEL) == CHECK


def test_a_made_up_effect_conforms_and_is_told_apart_as_its_file_says(leaning: Dataset) -> None:
    fitted = identify(leaning)
    survey = Survey.of(fitted, leaning)
    check_effect(leaning_axis(3), fitted.model, leaning.conditions)
    assert LABEL in {each.label for each in offers(survey)}
    rivals = {("coupling:j3-j4", LABEL): fitted}  # a rival that predicts the same is separated by no pose
    few = later_visits(fitted, np.zeros((2, 6)), np.ones(2), np.full(2, 0.1), ["T1", "T1"])
    assert separating(fitted, rivals, few).procedures == (
        f"To distinguish coupling:j3-j4 from {LABEL}: {APART}",
    )


def wobble(slot: str, joint: int, order: float) -> Effect:
    """A harmonic of one joint's angle on any slot; parameters cos and sin, deg."""
    label = f"wobble:{slot}-j{joint}:n{order:g}"
    acts = {
        "cos": ("deg", 0.1, [(slot, Cosine(joint, order))]),
        "sin": ("deg", 0.1, [(slot, Sine(joint, order))]),
    }
    return effect(label, "structure", "robot", f"{slot} wobbles with joint {joint}.", acts, {"order": order})


class Tuned:
    """Family of a new kind: a warm-up of 300 s that is always refined to 100 s."""

    label = "warm_up"

    def __init__(self, survey: Survey) -> None:
        self.robot = survey.robot

    def scores(self, space: Space) -> FamilyScores:
        return Candidate(warm_up(self.robot, 300.0)).scores(space)

    def made(self, effect: Effect) -> bool:
        return effect.label == self.label

    @classmethod
    def refine(cls, space: Space, own: Sequence[tuple[Tuned, Effect]]) -> list[Effect]:
        return [warm_up(family.robot, 100.0) for family, _ in own]


def test_a_kind_of_family_is_scanned_and_refined_by_its_own_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = SimpleNamespace(KINDS=(), offer=lambda survey: [Tuned(survey)])
    monkeypatch.setattr(effects, "LIBRARY", (file,))
    _, data = simulate(tmp_path, seed=6, n=60, n_validation=0, effects=["warm_up"], size=6.0)
    fitted = identify(data)
    found = Scores(offers(Survey.of(fitted, data)), Space.of(fitted)).best_of(0)
    assert found.gain > 0.0
    assert found.effect.shape["time_constant_s"] == 300.0
    space = Space.of(refit(data, fitted, (found.effect,)))
    assert refine(space, (found.effect,)) == (warm_up(load_robot("abb-irb120"), 100.0),)


@pytest.mark.parametrize(("slot", "joint"), [("alpha3", 3), ("theta5", 4)])
def test_a_harmonic_of_any_joint_on_any_slot_is_found_and_its_order_refined(
    slot: str, joint: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its order lies between those that are scanned."""
    orders = np.arange(1.0, 12.1, 0.25)
    family = Harmonics(
        f"wobble:{slot}-j{joint}", joint, ((slot, 1.0),), orders, partial(wobble, slot, joint), 0.5
    )
    file = SimpleNamespace(
        KINDS=(EffectKind("wobble", "Look at the bearing of the axis.", ()),), offer=lambda survey: [family]
    )
    monkeypatch.setattr(effects, "LIBRARY", (*LIBRARY, file))
    _, data = simulate(tmp_path, seed=6, n=150, n_validation=0, effects=[])
    fitted = identify(data)
    design = BoundModel(fitted.model.append(wobble(slot, joint, 4.6)), data.conditions)
    none, some = np.append(fitted.estimate, [0.0, 0.0]), np.append(fitted.estimate, [0.05 * DEG, 0.02 * DEG])
    moved = replace(data, points=data.points + design.predict(some) - design.predict(none))
    (found,) = (each.effect for each in diagnose(moved).effects)
    assert found.label.startswith(family.label)
    assert found.shape["order"] == pytest.approx(4.6, abs=0.06)
    assert {term.slot for term in found.terms} == {slot}
