"""The picture beside a prompt, in the two forms in which people see one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.interfaces import Answer


@dataclass(frozen=True)
class PromptPicture:
    """One picture.

    name: what the page draws by itself, from the cell that it shows anyway: `seat/NEST`, `aim/NEST`, `moved/NEST`,
    `off`, `span/BASE/TOOL`, `calibrator`. Record and interface keep the name. None: the page has words alone.
    drawing: SVG, for a person at a terminal, which draws nothing: a file beside the record that a browser shows.
    """

    name: str | None = None
    drawing: str | None = None


WORDS_ALONE = PromptPicture()

Ask = Callable[[str, PromptPicture], Answer]
"""Puts a question to a person and waits for the answer."""
