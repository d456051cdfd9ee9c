"""The follow-up sections: next measurements, and the resolved ambiguities of a closed loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from acquisition.loop import FollowUpResult
from calib.diagnose import SEPARATES, DiagnosedEffect, DiagnosisFit, FollowUp
from service import wording

Weights = Sequence[tuple[str, float]]


def section_of(follow_up: FollowUp | None) -> Mapping[str, Any] | None:
    """Build the section on the poses to be measured next; None if nothing is ambiguous."""
    if follow_up is None:
        return None
    return {
        "poses": wording.counted(len(follow_up.joints), "pose"),
        "pairs": pairs_of(follow_up),
        "settles": f"{SEPARATES:g}",
        "procedures": follow_up.procedures,
    }


def pairs_of(follow_up: FollowUp) -> list[tuple[str, str, str, bool]]:
    """Return the rivals of a follow-up.

    Each is (effect, rival, expected squared distance as text, whether it settles the pair).
    """
    return [
        (label, rival, f"{square:.0f}", square >= SEPARATES)
        for (label, rival), square in follow_up.separations.items()
    ]


def middle_step_of(step: FollowUpResult | None, after: DiagnosisFit) -> Mapping[str, Any] | None:
    """Build the section on the middle step; None if there was none."""
    if step is None:
        return None
    return {
        "words": middle_step_in_words(step, after),
        "pairs": pairs_of(step.poses),
        "rows": [
            ("before the follow-up", *row_of(step.before), step.before.error_after),
            ("after it", *row_of(after), after.error_after),
        ],
    }


def row_of(diagnosis: DiagnosisFit) -> tuple[str, list[Weights]]:
    """Verdict and, for every effect, its candidates with their weights, heaviest first."""
    return wording.VERDICT_NAMES[diagnosis.verdict], [_class_of(found) for found in diagnosis.effects]


def middle_step_in_words(step: FollowUpResult, after: DiagnosisFit) -> str:
    """Return the middle step in a sentence or two."""
    unsettled = [found for found in step.before.effects if not found.evidence.certain]
    what = "; ".join(" or ".join(label for label, _ in _class_of(found)) for found in unsettled)
    names = ", ".join(found.effect.label for found in after.effects) or "no effect"
    left = [found.effect.label for found in after.effects if not found.evidence.certain]
    outcome = f"still cannot distinguish {', '.join(left)} from its rivals" if left else f"name {names}"
    return (
        f"The first readings could not decide: {what}. "
        f"{wording.counted(len(step.poses.joints), 'pose')} were chosen to distinguish them, driven and measured "
        f"({wording.counted(step.readings, 'reading')}); with them the readings {outcome}."
    )


def _class_of(found: DiagnosedEffect) -> Weights:
    return [(label, w) for label, w in found.evidence.candidates.items() if w >= 0.01]
