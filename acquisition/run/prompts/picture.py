"""The picture of a prompt, in the two forms for a page and for a terminal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.interfaces import Answer


@dataclass(frozen=True)
class PromptPicture:
    """A picture of a prompt.

    Attributes
    ----------
    name
        A picture that the page draws from the cell: `seat/NEST`, `aim/NEST`, `moved/NEST`, `off`, `span/BASE/TOOL`,
        `calibrator`. Record and interface keep the name. None: the page has only the text.
    drawing
        SVG for a person at a terminal, which cannot draw. It is written to a file in the folder of the record, which a
        browser shows.
    """

    name: str | None = None
    drawing: str | None = None


WORDS_ALONE = PromptPicture()

Ask = Callable[[str, PromptPicture], Answer]
"""Puts a question to a person and waits for the answer."""
