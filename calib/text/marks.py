"""Marks that turn the direction of writing: a name that holds one is read otherwise than it is stored.

U+061C, U+200E and U+200F, the embeddings U+202A to U+202E and the isolates U+2066 to U+2069. Source: Unicode Standard
Annex 9, "Bidirectional Algorithm", section 2.
"""

from __future__ import annotations

import re

_TURNS = re.compile("[\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def turns_writing(text: str) -> bool:
    """Whether a text holds such a mark."""
    return _TURNS.search(text) is not None
