"""Numbers as people type or paste them, in one row or several.

They may have a decimal comma or point, names and units. Ambiguous text is refused with the reason, never guessed:
thousands separators, commas between numbers without a blank, another count than requested, another unit.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

MOST_CHARACTERS = 2000
MOST_ROWS = 20
_LARGEST = 1e6
_NUMBER = re.compile(r"[+-]?\d{1,9}(?:[.,]\d{1,12})?")
_SEPARATORS = re.compile(r"[\s;|]+|,(?=\s)")
_NAMED = re.compile(r"(?P<name>[A-Za-z]\w{0,15})[:=](?P<rest>.*)")
_MM = {"mm": 1.0, "m": 1000.0, "in": 25.4}
UNITS: dict[str, tuple[str, ...]] = {unit: (unit,) for unit in _MM} | {
    "deg": ("deg", "°"),
    "deg or mm": ("deg", "°", "mm"),
}
"""What may stand behind numbers in each unit."""
MM_OF = _MM
"""Millimetres in one of each unit of length."""


@dataclass(eq=False)
class InvalidEntry(Exception):
    """An entry that cannot be accepted as it was typed.

    Attributes
    ----------
    reason
        A word for tables of texts.
    name
        Name of the number.
    words
        The reason in full.
    """

    reason: str
    name: str
    words: str


@dataclass(frozen=True)
class TypedRow:
    """A row that was typed: its numbers, and each as text with a decimal point."""

    values: tuple[float, ...]
    texts: tuple[str, ...]


def rows_of(text: str, names: Sequence[str], unit: str) -> list[TypedRow]:
    """Parse the rows of a text, one number per name.

    Raises
    ------
    InvalidEntry
        The text is ambiguous, or has another count of numbers.
    """
    if len(text) > MOST_CHARACTERS:
        raise InvalidEntry("count", "", f"more than {MOST_CHARACTERS} characters were typed")
    tokens = [token for token in _SEPARATORS.split(text.replace("\u2212", "-").strip()) if token]
    numbers: list[str] = []
    for token in _apart(tokens, names):
        name = names[len(numbers) % len(names)]
        if token.casefold().rstrip(".") in UNITS[unit] and numbers:
            continue
        if token in names:  # "X 12.5 Y 3.0"
            _refuse_order(token, name)
            continue
        numbers.append(_number(token, name, unit))
    if not numbers or len(numbers) % len(names) or len(numbers) > MOST_ROWS * len(names):
        raise InvalidEntry(
            "count",
            "",
            f"{len(numbers)} {'number was' if len(numbers) == 1 else 'numbers were'} typed, "
            f"{len(names)} are needed ({', '.join(names)})",
        )
    if any("," in number for number in numbers) and any("." in number for number in numbers):
        raise InvalidEntry("mixed", "", "some numbers have a decimal comma and others a decimal point")
    texts = [number.replace(",", ".") for number in numbers]
    width = len(names)
    return [
        TypedRow(tuple(map(float, texts[i : i + width])), tuple(texts[i : i + width]))
        for i in range(0, len(texts), width)
    ]


def _apart(tokens: Sequence[str], names: Sequence[str]) -> list[str]:
    """Split `x=12.5` into `x` and `12.5`, with names in their requested form."""
    asked = {name.casefold(): name for name in names}
    found: list[str] = []
    for token in tokens:
        match = _NAMED.fullmatch(token)
        parts = [match["name"], match["rest"]] if match else [token]
        found += [asked.get(part.casefold(), part) for part in parts if part and part not in ":="]
    return found


def _refuse_order(token: str, name: str) -> None:
    if token != name:
        raise InvalidEntry("order", name, f"{token} stands where {name} belongs")


def _number(token: str, name: str, unit: str) -> str:
    for behind in UNITS[unit]:
        if token.endswith(behind) and _NUMBER.fullmatch(token.removesuffix(behind)):
            token = token.removesuffix(behind)
    if "." in token and "," in token:
        raise InvalidEntry(
            "mixed", name, f"{token!r} has a comma and a point: type it without thousands separators"
        )
    if token.count(",") > 1 or token.count(".") > 1:
        raise InvalidEntry(
            "mixed", name, f"{token!r}: put a blank between numbers, and no thousands separators"
        )
    match = re.match(r"[+-]?[\d.,]{1,24}", token)
    if match and not _NUMBER.fullmatch(token) and _NUMBER.fullmatch(match[0]):
        raise InvalidEntry("unit", name, f"{token!r} is not in {unit}")
    if not _NUMBER.fullmatch(token):
        raise InvalidEntry("text", name, f"{token!r} is no number")
    if abs(float(token.replace(",", "."))) > _LARGEST:
        raise InvalidEntry("text", name, f"{token} is larger than anything that can be meant")
    return token
