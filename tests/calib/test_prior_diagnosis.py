"""Test a diagnosis with a type prior: effect sizes, search tries, and no prior-only claim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from calib import Dataset, DiagnosisFit, identify, load_robot
from calib.arm.robot import robot_hash
from calib.diagnose import DiagnosedEffect as Named
from calib.diagnose import diagnose
from calib.diagnose.diagnosis import in_type
from calib.effects import Survey, offers
from calib.fit.identify import fit_plain
from calib.fit.type_prior import TypeEffect, TypeFit, TypeParameter, TypePrior
from calib.scan import Scores, Space
from calib.scan.families import StepScores
from tests.calib.campaigns import simulate

GROUPS = ("geometry", "parallel_twist", "compliance")
GAP = "backlash:j4.gap"
SPREAD = 0.004


def prior_of(gap_deg: float, spread_deg: float = SPREAD) -> TypePrior:
    """Build a type with play in joint 4 of all its 30 robots as its only information."""
    robot = load_robot("abb-irb120")
    return TypePrior(
        robot=robot.name,
        robot_sha256=robot_hash(robot),
        coupling="none",
        groups=GROUPS,
        shares={GAP: TypeParameter(GAP, "deg", gap_deg, spread_deg)},
        redundant=(),
        found=(TypeEffect("backlash:j4", {}, 30), TypeEffect("periodic:j2:n2", {"order": 2.0}, 10)),
        robots=30,
        sha256="",
    )


@dataclass(frozen=True)
class Case:
    """Robot with play in joint 4, diagnosed with a type whose mean is a tenth above it."""

    dataset: Dataset
    centre_deg: float
    diagnosis: DiagnosisFit


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    folder = tmp_path_factory.mktemp("play")
    campaign, dataset = simulate(folder, "abb-irb120", 5, 160, 20, ["backlash:j4"], 2.0)
    centre = 1.1 * campaign.world.effects[0].values["gap"]
    return Case(dataset, centre, diagnose(dataset, prior=prior_of(centre)))


def without(case: Case) -> tuple[float, float]:
    """The play and its standard error by the readings alone, deg."""
    final = case.diagnosis.final
    usual = replace(
        final.model,
        effects=tuple(
            replace(
                e,
                parameters=tuple(
                    replace(p, size=0.1, centre=None) if p.name == GAP else p for p in e.parameters
                ),
            )
            for e in final.model.effects
        ),
    )
    again = fit_plain(
        case.dataset, usual, final.readings, final.estimate, np.diag(final.covariance) > 0.0, final.dropped
    )
    at = usual.index[GAP]
    return float(np.degrees(again.estimate[at])), float(np.degrees(again.standard_errors[at]))


def gap_of(found: Sequence[Named]) -> tuple[float, float]:
    """Estimate and standard error of the play, deg."""
    one = next(f for f in found if f.effect.label == "backlash:j4")
    return float(np.degrees(one.values[0])), float(np.degrees(np.sqrt(one.covariance[0, 0])))


def test_an_effect_that_was_found_is_weighed_with_its_type(case: Case) -> None:
    value, error = without(case)
    final = case.diagnosis.final
    assert final.beside is not None
    assert not final.beside.outside
    held, sure = gap_of(case.diagnosis.effects)
    readings, of_type = error**-2.0, SPREAD**-2.0
    assert sure == pytest.approx((readings + of_type) ** -0.5, rel=0.03)
    expected = (readings * value + of_type * case.centre_deg) / (readings + of_type)
    assert held == pytest.approx(expected, abs=0.05 * sure)
    decided = [(w.name, w.decided) for w in final.weighed]
    assert decided == [(GAP, pytest.approx(of_type / (readings + of_type), abs=0.03))]


def test_an_effect_outside_the_type_keeps_the_size_that_the_readings_say(case: Case) -> None:
    value, error = without(case)
    beside = TypeFit(prior_of(value + 30.0 * error))
    final, found = in_type(case.dataset, case.diagnosis.final, beside, [*case.diagnosis.effects], refit=True)
    assert final.beside is not None
    # the usual size of play is that of the library again, as the effect was found
    assert [w.name for w in final.beside.outside] == [GAP]
    assert any(GAP in warning for warning in final.warnings)
    assert found[0].effect.label == case.diagnosis.effects[0].effect.label


def test_nothing_is_claimed_because_the_type_has_it(tmp_path: Path) -> None:
    _, dataset = simulate(tmp_path, "abb-irb120", 6, 160, 20, [])
    assert diagnose(dataset, prior=prior_of(0.03)).effects == ()


def test_the_tries_of_a_search_add_up_to_one(case: Case) -> None:
    """The tries of a search keep their sum, so a search errs no more often.

    An effect that the type makes likelier takes its share from all others.
    """
    plain = identify(case.dataset)
    for expected in ((), prior_of(0.03).expected):
        fitted = replace(plain, model=replace(plain.model, expected=expected))
        scores = Scores(offers(Survey.of(fitted, case.dataset)), Space.of(fitted))
        tries = {
            (index, place): scores.multiplicity(index, place)
            for index, a in enumerate(scores.a)
            for place in range(len(a))
            if not (
                isinstance(family := scores.families[index], StepScores) and family.rivals[place]
            )  # never chosen
        }
        assert sum(1.0 / count for count in tries.values()) <= 1.0 + 1e-9
        for place, share in scores.shares.items():
            assert 0.9 / share < tries[place] < 1.0 / share
        assert len(scores.shares) == len(expected)
        copied = scores.copy()
        assert copied.multiplicity(0, 0) == scores.multiplicity(0, 0)
