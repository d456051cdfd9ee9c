"""TOML from files and requests: bounded reading, typed getters, and no unknown keys.

A wrong value is refused with file and key. Reading is bounded, with finite numbers and a few levels. An
unknown key is refused, because a misspelt one would be ignored and its default used.

Marks that turn the direction of writing are refused too: a name with one is read differently from how it
is stored. They are U+061C, U+200E and U+200F, the embeddings U+202A to U+202E and the isolates U+2066 to
U+2069. Source: Unicode Standard Annex 9, "Bidirectional Algorithm", section 2.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

from calib.errors import DataError
from calib.text.plain_values import LONGEST_TEXT, refuse_unusual, too_deep
from calib.text.text_file import read_text

FARTHEST_MM = 1e8
"""No coordinate is larger: squares of what is would drown all others."""

Vector = tuple[float, float, float]
Word = TypeVar("Word", bound=str)
_TURNS = re.compile("[\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")
MOST_BYTES = 8 * 1024 * 1024
"""A campaign of 5,000 listed poses has half a megabyte."""

_PARTS = 40

# Python's reader takes time and memory with the square of the parts of a key: a.a.a.a...
_LONG_KEY = re.compile(
    rf"(?<![\w-])(?:(?:[\w-]++|\"[^\"\n]*+\"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_PARTS}}}", re.ASCII
)

_NEAR = 0.6  # likeness, of 1, from which a key may be meant


class TomlTable:
    """The values of one table, the file they come from, and the key of the table in it. Getters raise DataError."""

    def __init__(self, values: Mapping[str, Any], file: Path | str, prefix: str = "") -> None:
        self.values, self.file, self.prefix = values, file, prefix

    def refuse(self, key: str, what: str, do: str) -> DataError:
        """Build the error for a key.

        `what` is a sentence about the value, `do` one on the correct value.
        """
        return DataError(what, do=do, file=self.file, key=self.prefix + key)

    def _given(self, key: str, default: object) -> Any:
        value = self.values.get(key, default)
        if value is None:
            raise self.refuse(key, "is missing.", "Add it; the unit of a number is in the key's name.")
        return value

    def only(self, known: Iterable[str]) -> None:
        """Refuse keys that are not read: a mistyped limit must not pass for a limit."""
        allowed = sorted(known)
        for key in self.values:
            if key not in allowed:
                raise self.refuse(key, "is not known here.", f"There are {', '.join(allowed)}.")

    def table(self, key: str) -> TomlTable:
        """Return a table below this one; empty if absent."""
        value = self.values.get(key, {})
        if not isinstance(value, Mapping):
            raise self.refuse(key, f"is {value!r}.", f"Make it a table, [{self.prefix}{key}].")
        return TomlTable(value, self.file, f"{self.prefix}{key}.")

    def tables(self, key: str) -> list[TomlTable]:
        """Return an array of tables; empty if absent."""
        value = self.values.get(key, [])
        if not isinstance(value, Sequence) or not all(isinstance(each, Mapping) for each in value):
            raise self.refuse(key, f"is {value!r}.", f"Write [[{key}]] tables.")
        return [TomlTable(each, self.file, f"{self.prefix}{key}[{i}].") for i, each in enumerate(value)]

    def text(self, key: str, default: str | None = None, allowed: Sequence[str] | None = None) -> str:
        """Return a text, one of `allowed`; it may be empty if the default is."""
        value = self._given(key, default)
        if not isinstance(value, str) or not (value or default == "") or value not in (allowed or (value,)):
            wanted = "text" if allowed is None else " or ".join(repr(a) for a in allowed)
            raise self.refuse(key, f"is {value!r}.", f"Use {wanted}.")
        if turns_writing(value):
            raise self.refuse(
                key, f"is {value!r}.", "Leave out the marks that turn the direction of writing."
            )
        return value

    def word(self, key: str, allowed: Sequence[Word], default: Word | None = None) -> Word:
        """Return a text that is one of `allowed`."""
        return allowed[allowed.index(self.text(key, default, allowed))]

    def flag(self, key: str, default: bool = False) -> bool:
        value = self.values.get(key, default)
        if not isinstance(value, bool):
            raise self.refuse(key, f"is {value!r}.", "Use true or false.")
        return value

    def number(
        self, key: str, default: float | None = None, *, low: float = -math.inf, high: float = math.inf
    ) -> float:
        value = self._given(key, default)
        if not _is_number(value) or not low <= value <= high:
            raise self.refuse(key, f"is {value!r}.", f"Give a number{_range(low, high)}.")
        return float(value)

    def whole(self, key: str, default: int | None = None, *, low: int = 0, high: int = 1_000_000) -> int:
        value = self._given(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.refuse(key, f"is {value!r}.", f"Give a whole number{_range(low, high)}.")
        return value

    def vector(self, key: str, default: Vector | None = None) -> Vector:
        """Three numbers, a place in mm or a direction."""
        value = self.values.get(key, default)
        if not _are_numbers(value, 3):
            raise self.refuse(key, f"is {value!r}.", "Give three numbers, [x, y, z].")
        x, y, z = value
        if max(abs(x), abs(y), abs(z)) > FARTHEST_MM:
            raise self.refuse(key, f"is {value!r}: farther than anything on earth.", "Give it in mm.")
        return float(x), float(y), float(z)

    def vectors(self, key: str) -> dict[str, Vector]:
        """Return named points, `{ T1 = [x, y, z], ... }`; empty if absent."""
        table = self.table(key)
        return {name: table.vector(name) for name in table.values}

    def numbers(self, key: str) -> tuple[float, ...] | None:
        """Return a list of numbers, not empty; None if absent."""
        value = self.values.get(key)
        if value is None:
            return None
        if not isinstance(value, list | tuple) or not value or not _are_numbers(value, len(value)):
            raise self.refuse(key, f"is {value!r}.", "Give a list of numbers.")
        return tuple(float(x) for x in value)

    def names(self, key: str) -> tuple[str, ...] | None:
        """Return a list of names, each once, not empty; None if absent."""
        value = self.values.get(key)
        if value is None:
            return None
        good = isinstance(value, list | tuple) and all(isinstance(name, str) and name for name in value)
        if not good or not value or len(set(value)) != len(value):
            raise self.refuse(key, f"is {value!r}.", f"List names of {key}, each once.")
        return tuple(value)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _are_numbers(value: object, count: int) -> TypeGuard[Sequence[float]]:
    return isinstance(value, list | tuple) and len(value) == count and all(_is_number(x) for x in value)


def _range(low: float, high: float) -> str:
    if math.isfinite(low) and math.isfinite(high):
        return f" from {low:g} to {high:g}"
    if math.isfinite(low):
        return f", {low:g} or above" if low else ", zero or above"
    return f", {high:g} or below" if math.isfinite(high) else ""


def turns_writing(text: str) -> bool:
    """Test whether a text holds a mark that turns the direction of writing."""
    return _TURNS.search(text) is not None


def read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Read text and table of a TOML file.

    Raises
    ------
    DataError
        The file cannot be read; the error names file, and line or key.
    """
    text = read_text(path, MOST_BYTES)
    return text, parse_toml(text, path)


def parse_toml(text: str, file: Path | str) -> dict[str, Any]:
    """Parse TOML text.

    Raises
    ------
    DataError
        The text is not TOML, or holds unusual values.
    """
    if len(text) > MOST_BYTES:
        raise DataError(f"is larger than {MOST_BYTES // 2**20} MB.", do="Check the file.", file=file)
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise DataError(
            f"a key has more than {_PARTS} parts.", do="Correct that place.", file=file, line=line
        )
    try:
        table = tomllib.loads(text)
    except RecursionError as error:
        raise too_deep(file) from error
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"is not valid TOML ({error}).", do="Correct that place.", file=file) from error
    except ValueError as error:
        raise DataError(
            "holds an integer of thousands of digits.", do="Give a number of 64 bits.", file=file
        ) from error
    refuse_unusual(table, file, longest=LONGEST_TEXT)
    return table


def refuse_unknown(
    values: Mapping[str, Any],
    known: Iterable[str],
    file: Path | str,
    prefix: str = "",
    meant: Mapping[str, str] | None = None,
) -> None:
    """Raise DataError for the first key of a table that is not among `known`.

    The error names the nearest known key.

    Parameters
    ----------
    prefix : str, optional
        Key of the table itself, with its full stop.
    meant : mapping of str to str, optional
        Words of other formats, and the key for which they stand.
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
    """Suggest similar names as a question with a blank behind, or ''.

    They are the names that contain this one, otherwise the three that are most similar.
    """
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
