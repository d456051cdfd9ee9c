"""Effects before readers: words first, the label second; a class of rivals as all its members, not as one."""

from __future__ import annotations

from collections.abc import Sequence

from calib.diagnose import DiagnosedEffect
from calib.effects import words_of

_LISTED = 3  # members of a class that a sentence names
_COUNTS = 0.01  # weight below which a member is not named


def members_of(found: DiagnosedEffect) -> list[tuple[str, str, float]]:
    """(words, label, weight) of every effect that this finding may be, heaviest first; one where it is certain."""
    evidence, own = found.evidence, found.effect.label
    if evidence.certain:
        return [(words_of(own), own, evidence.candidates.get(own, 1.0))]
    ranked = list(evidence.candidates.items())
    named = [(label, w) for label, w in ranked if w >= _COUNTS]
    return [(words_of(label), label, w) for label, w in (named if len(named) > 1 else ranked[:2])]


def name_of(found: DiagnosedEffect) -> str:
    """A finding in a few words; of a class "either this or that", with how many more there are."""
    names = [words for words, _, _ in members_of(found)]
    if len(names) == 1:
        return names[0]
    shown, more = names[:_LISTED], len(names) - _LISTED
    if more > 0:
        return f"one of {len(names)}: {', '.join(shown)} or {more} more"
    return f"either {', '.join(shown[:-1])} or {shown[-1]}"


def listed(found: Sequence[DiagnosedEffect], most: int = 3) -> str:
    """Findings in a row, at most so many of them in words."""
    text = "; ".join(name_of(each) for each in found[:most])
    return text + (f"; and {len(found) - most} more" if len(found) > most else "")
