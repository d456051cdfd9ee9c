"""Hypothesis draws the same examples in every run, whatever else is loaded."""

from __future__ import annotations

from hypothesis.internal.conjecture.providers import HypothesisProvider


def test_examples_do_not_depend_on_the_modules_loaded() -> None:
    found = HypothesisProvider(None)._local_constants
    assert not len(found)
