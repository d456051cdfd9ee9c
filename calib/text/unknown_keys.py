"""The refusal of unknown keys: a misspelt one would be ignored and its default used."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from calib.errors import DataError

_NEAR = 0.6  # likeness, of 1, from which a key may be meant


def refuse_unknown(
    values: Mapping[str, Any],
    known: Iterable[str],
    file: Path | str,
    prefix: str = "",
    meant: Mapping[str, str] | None = None,
) -> None:
    """Raise DataError for the first key of a table that is not among `known`, naming the nearest that is.

    prefix: the key of the table itself, with its full stop; meant: words of other formats and the key they stand for.
    """
    allowed = sorted(known)
    for key in values:
        if key not in allowed:
            near = [meant[key]] if meant and key in meant else get_close_matches(key, allowed, 1, _NEAR)
            hint = f"Did you mean '{near[0]}'? " if near else ""
            raise DataError(
                "is not known here.", do=f"{hint}There are {', '.join(allowed)}.", file=file, key=prefix + key
            )


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The names that hold this one, else the three that are most like it, as a question with a blank behind, or ''."""
    plain = {each: _plain(each) for each in known}
    near = [each for each, word in plain.items() if _plain(name) and _plain(name) in word]
    near = near or [
        each
        for word in get_close_matches(_plain(name), plain.values(), 3, _NEAR)
        for each, other in plain.items()
        if other == word
    ]
    return f"Did you mean {' or '.join(repr(each) for each in near[:3])}? " if near else ""


def _plain(name: str) -> str:
    return "".join(letter for letter in name.lower() if letter.isalnum())
