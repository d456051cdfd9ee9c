"""Numbers as text: rounding by the uncertainty, and JSON that never holds NaN."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.diagnose import ACTS_ON, HeldOutTest, ResidualStructure, Shares
from calib.fit import ErrorStatistics, HeldOutFaults
from service.files import as_json
from service.results.common import reading
from service.wording import chance, counted, grouped, structure_in_words, verdict_in_words, with_uncertainty

NO_FAULTS = HeldOutFaults((), np.zeros(1, dtype=np.bool_), None)


@pytest.mark.parametrize(
    ("value", "uncertainty", "shown"),
    [
        (0.0704849, 0.00184, ("0.0705", "0.0018")),
        (-0.0704849, 0.00184, ("-0.0705", "0.0018")),
        (403.7, 11.3, ("404", "11")),
        (1234.0, 260.0, ("1230", "260")),
        (1.0, 0.0996, ("1.00", "0.10")),
        (5.0, 0.0, ("5", "0")),
        (5.0, float("inf"), ("5", "0")),
    ],
)
def test_values_end_at_the_second_digit_of_their_uncertainty(
    value: float, uncertainty: float, shown: tuple[str, str]
) -> None:
    assert with_uncertainty(value, uncertainty) == shown


@given(st.floats(-1e6, 1e6), st.floats(1e-9, 1e6))
def test_rounding_loses_less_than_a_tenth_of_the_uncertainty(value: float, uncertainty: float) -> None:
    shown, spread = with_uncertainty(value, uncertainty)
    assert abs(float(shown) - value) <= 0.06 * uncertainty
    assert float(spread) == pytest.approx(uncertainty, rel=0.06)


def test_chances_nobody_believes_are_not_spelled_out() -> None:
    assert chance(3e-304) == "< 1e-12"
    assert chance(0.0) == "< 1e-12"
    assert chance(0.0123) == "0.012"


@pytest.mark.parametrize(
    ("name", "id_"), [("17", 17), ("017", "017"), ("A7", "A7"), ("-1", "-1"), ("٣", "٣")]
)
def test_reading_ids_are_numbers_where_they_are_whole_numbers(name: str, id_: int | str) -> None:
    assert reading(name) == id_


def test_warnings_that_say_the_same_of_many_become_one() -> None:
    warnings = ["d2 is weak.", "The fit did not converge.", "d3 is weak.", "d4 is weak."]
    assert grouped(warnings) == ["Each of d2, d3 and d4 is weak.", "The fit did not converge."]
    assert grouped(warnings, most=1)[0] == "Each of d2 and 2 more is weak."
    assert grouped(warnings[:3]) == ["d2 is weak.", "d3 is weak.", "The fit did not converge."]


def errors(rms: float) -> ErrorStatistics:
    return ErrorStatistics(40, rms, rms, rms, rms)


@pytest.mark.parametrize("verdict", ["attributed", "ambiguous", "unexplained"])
def test_effects_that_do_not_carry_over_are_not_praised(verdict: str) -> None:
    evidence = SimpleNamespace(certain=True, candidates={"backlash:j4": 1.0})
    found = SimpleNamespace(effect=SimpleNamespace(label="backlash:j4"), evidence=evidence)
    diagnosis: Any = SimpleNamespace(
        verdict=verdict,
        effects=(found,),
        confirmed=(found,),
        structure=(),
        carried=(),
        causes_known=True,
        shares=Shares(0.7, 0.0, 0.3),
        p_lack_of_fit=0.5,
        final=SimpleNamespace(noise_scale=1.0),
        error_before=errors(0.1),
        error_after=errors(0.2),
        stretch=1.1,
        surprise=HeldOutTest(1.1, 0.2),
        held_out_faults=NO_FAULTS,
        by_repeats=False,
        harmful=(),
    )
    text = verdict_in_words(diagnosis)
    assert "Nothing else" not in text
    assert text.startswith(
        "The effect found does not carry over to the held-out readings. The held-out error rises by 100\u00a0%"
    )
    diagnosis.error_before = errors(0.3)
    assert "carry over" not in verdict_in_words(diagnosis)
    assert ("Nothing else" in verdict_in_words(diagnosis)) == (verdict == "attributed")
    assert "let expect" not in verdict_in_words(diagnosis)
    diagnosis.harmful = ("backlash:j4",)
    assert verdict_in_words(diagnosis).startswith("Held-out readings speak against backlash:j4:")
    diagnosis.stretch = 2.4
    assert "2.4 times what the fit leaves on its own readings, which the uncertainty" in verdict_in_words(
        diagnosis
    )
    diagnosis.surprise = HeldOutTest(
        1.9, 1e-9
    )  # what the readings held out say cannot stand beside "nothing else is left"
    assert "Nothing else" not in verdict_in_words(diagnosis)
    assert "miss by 1.9 times what noise and the uncertainty" in verdict_in_words(diagnosis)


def test_noise_beyond_the_declared_is_said_where_repeats_explain_it() -> None:
    diagnosis: Any = SimpleNamespace(
        verdict="complete",
        effects=(),
        confirmed=(),
        structure=(),
        carried=(),
        causes_known=True,
        shares=Shares(0.7, 0.0, 0.3),
        p_lack_of_fit=0.5,
        final=SimpleNamespace(noise_scale=2.25),
        error_before=None,
        error_after=None,
        stretch=None,
        surprise=None,
        held_out_faults=NO_FAULTS,
        by_repeats=True,
        harmful=(),
    )
    assert "to the noise that visits of the same pose show, 2.2 times the declared." in verdict_in_words(
        diagnosis
    )


def test_a_law_in_the_readings_left_out_is_said_as_such() -> None:
    sentence = structure_in_words(ResidualStructure("overturning moment", 1e-6, 0.4, ACTS_ON))
    assert (
        sentence
        == "The readings left out lie together: overturning moment explains 40.0\u00a0% of which they are (p 1e-06)."
    )
    assert structure_in_words(ResidualStructure("time", 1e-6, 0.4)) == (
        "Structure is left: time explains 40.0\u00a0% of what is left (p 1e-06)."
    )


def test_one_is_not_many() -> None:
    assert [counted(n, "reading") for n in (0, 1, 2)] == ["0 readings", "1 reading", "2 readings"]


def test_nan_never_reaches_a_file() -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        as_json({"x": float("nan")})
