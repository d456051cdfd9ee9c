"""Names of effects for readers: description first, label second.

A class of rivals is shown with all its members, not as one effect.
"""

from __future__ import annotations

from collections.abc import Sequence

from calib.diagnose import DiagnosedEffect
from calib.effects import words_of

_LISTED = 3  # members of a class that a sentence names
_COUNTS = 0.01  # weight below which a member is not named


def members_of(found: DiagnosedEffect) -> list[tuple[str, str, float]]:
    """List the effects that this finding may be as (words, label, weight), heaviest first.

    The list has one entry if the finding is certain.
    """
    evidence, own = found.evidence, found.effect.label
    if evidence.certain:
        return [(words_of(own), own, evidence.candidates.get(own, 1.0))]
    ranked = list(evidence.candidates.items())
    named = [(label, w) for label, w in ranked if w >= _COUNTS]
    return [(words_of(label), label, w) for label, w in (named if len(named) > 1 else ranked[:2])]


def name_of(found: DiagnosedEffect) -> str:
    """Name a finding in a few words.

    A class of rivals reads "either this or that", or "one of n" with the number of members that are not listed.
    """
    names = [words for words, _, _ in members_of(found)]
    if len(names) == 1:
        return names[0]
    shown, more = names[:_LISTED], len(names) - _LISTED
    if more > 0:
        return f"one of {len(names)}: {', '.join(shown)} or {more} more"
    return f"either {', '.join(shown[:-1])} or {shown[-1]}"


def listed(found: Sequence[DiagnosedEffect], most: int = 3) -> str:
    """List findings in one text, at most `most` of them by name."""
    text = "; ".join(name_of(each) for each in found[:most])
    return text + (f"; and {len(found) - most} more" if len(found) > most else "")
