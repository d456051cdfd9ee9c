"""Test a small fixed part of `python -m tests.benchmarks diagnosis`.

The detectability of the effects is computed before any diagnosis. These would catch: an effect that is missed or
misnamed, a claim on a complete set, and a name although no law explains the error. They would also catch an error
that becomes larger, and follow-up poses that resolve nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.diagnose import select
from calib.effects import Survey, offers
from calib.effects.transmission import periodic
from calib.fit.identify import identify
from calib.scan.families import Candidate
from tests.benchmarks.diagnosis_follow_up import before_and_after
from tests.benchmarks.diagnosis_judge import examine, mechanism, without
from tests.benchmarks.diagnosis_sets import Draw, complete, departing, load, outside
from tests.benchmarks.diagnosis_truth import truth_of

IRB, LRM, UR = "abb-irb120", "fanuc-lrmate200ic", "ur10"


@pytest.mark.parametrize(
    "draw",
    [
        Draw("single", IRB, 301, ("coupling:j4-j5",), n=50, size=4.0),
        Draw("single", IRB, 302, ("drift_rotation",)),
        Draw("single", LRM, 303, ("thermal_joint:j3",), size=1.5),
        Draw("single", IRB, 304, ("periodic:j4:n34",), n=50, size=2.0),
        Draw("single", IRB, 305, ("settling:j4",), approach="direct"),
        Draw("single", IRB, 306, ("dead_zone:j4",), n=1000, size=0.8),
        Draw("pair", UR, 307, ("target_offset:T2", "periodic:j1:n120")),
        Draw("pair", IRB, 308, ("backlash:j2", "tool_shift"), size=2.0),
        Draw("triple", IRB, 309, ("bearing_tilt:j4", "thermal_growth", "periodic:j3:n120"), size=2.5),
    ],
    ids=lambda d: "+".join(d.labels),
)
def test_what_the_data_can_show_is_named_and_nothing_else(draw: Draw) -> None:
    case = examine(draw)
    assert case is not None
    assert [s.label for s in case.shown] == list(draw.labels), "the set is none that counts"
    assert len(case.classes) == len(draw.labels), str(case)
    assert all(case.unique(label) for label in draw.labels), str(case)
    assert case.verdict == "attributed", str(case)
    assert case.after < 1.1 * case.truth.ideal, str(case)
    assert case.after < case.before, str(case)


@pytest.mark.parametrize(("seed", "declared"), [(401, 1.0), (402, 1.0), (403, 0.8)])
def test_nothing_is_named_where_nothing_is_missing(seed: int, declared: float) -> None:
    case = examine(complete(seed, declared))
    assert case is not None
    assert case.classes == (), str(case)


@pytest.mark.parametrize("seed", [505, 508])
def test_a_law_that_departs_from_the_textbook_is_known_by_its_mechanism(seed: int) -> None:
    case = examine(replace(departing(seed), n=200, size=3.0))
    assert case is not None
    assert case.right_mechanism(case.truth.effects[0].label), str(case)


@pytest.mark.parametrize("seed", [601, 602])
def test_structure_that_no_law_describes_is_said_to_be_unexplained(seed: int) -> None:
    case = examine(replace(outside(seed), n=200, size=2.0))
    assert case is not None
    assert case.truth.effects[0].size > 200.0
    assert case.verdict == "unexplained", str(case)


def test_without_the_law_no_other_mechanism_is_told_as_the_cause() -> None:
    case = examine(Draw("missing", IRB, 702, ("thermal_growth",)), missing=True)
    assert case is not None
    assert not any("thermal_growth" in candidates for candidates in case.classes)
    assert case.verdict != "attributed" or not case.wrong_mechanism, str(case)


def test_an_ambiguous_start_is_settled_by_the_poses_asked_for() -> None:
    found = before_and_after(100_008)
    assert found is not None, "nothing was ambiguous"
    before, after = found.before, found.after
    label = after.truth.effects[0].label
    assert before.verdict == "ambiguous"
    assert after.verdict == "attributed", str(after)
    assert after.unique(label), str(after)
    assert before.truth.effects[0].gap < 10.0 < after.truth.effects[0].gap


def test_lambda_gap_and_ideal_are_those_of_real_fits() -> None:
    """Lambda, gap and ideal agree with fits on the exact chain.

    The fits use noise-free readings, these with the rival, and readings with the law.
    """
    draw = Draw("single", IRB, 801, ("periodic:j2:n4",))
    campaign = draw.campaign()
    data = load(campaign)
    truth = truth_of(campaign, data)
    shown = truth.effects[0]
    exact = replace(data, points=np.array([campaign.world.indicated_point(*r) for r in campaign.readings]))
    base = identify(exact)
    assert float(np.sum(base.residual**2)) == pytest.approx(shown.size, rel=0.02)
    order = float(shown.rival.rpartition(":n")[2])
    assert shown.rival == f"periodic:j2:n{order:g}"
    with_rival = select.refit(exact, base, (periodic(2, order),))
    assert float(np.sum(with_rival.residual**2)) == pytest.approx(shown.gap, rel=0.02)
    with_law = select.refit(data, identify(data), (periodic(2, 4.0),))
    rows = data.validation_rows
    error = with_law.predict(data.conditions.take(rows)) - data.points[rows]
    assert float(np.sqrt(np.mean(np.sum(error**2, axis=1)))) == pytest.approx(truth.ideal, rel=0.01)


def test_the_library_is_smaller_only_while_a_law_is_taken_out() -> None:
    data = load(Draw("single", IRB, 802, (), n=50).campaign())
    survey = Survey.of(identify(data), data)
    whole = {offer.label for offer in offers(survey)}
    with without("periodic:j2:n4", "backlash:j1"):
        assert whole - {offer.label for offer in select.offers(survey)} == {"periodic:j2", "backlash:j1"}
    assert {offer.label for offer in select.offers(survey)} == whole


def test_mechanisms_know_their_joint_and_every_law() -> None:
    data = load(Draw("single", IRB, 803, (), n=50).campaign())
    for offer in offers(Survey.of(identify(data), data)):
        label = offer.label if isinstance(offer, Candidate) else f"{offer.label}:n3"
        assert mechanism(label) != label.partition(":")[0], label
    assert mechanism("periodic:j2:n4") == mechanism("encoder_scale:j2") != mechanism("encoder_scale:j3")
    assert mechanism("coupling:j2-j3") == mechanism("periodic:j3:n1")
    assert mechanism("dead_zone:j4") == mechanism("cubic_stiffness:j4") != mechanism("backlash:j4")
