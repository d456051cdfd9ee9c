"""Slips of the hand: the single slip that turns the expected numbers into the typed ones.

    order   two numbers exchanged           sign    one of them with the other sign
    swap    two neighbouring digits          digit   a digit missing, doubled or another one
    point   the decimal point elsewhere      unit    all numbers in another unit

A slip is only named where the numbers are off, and would be within the tolerance without it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

from drivers.manual.typed import TypedRow

_UNITS = (1000.0, 0.001, 25.4, 1.0 / 25.4, math.degrees(1.0), math.radians(1.0))


@dataclass(frozen=True)
class TypingSlip:
    """A slip of the hand.

    `index` is that of the number, None if it concerns all; `meant` has the intended numbers.
    """

    reason: str
    index: int | None
    meant: tuple[float, ...]


def slip_of(row: TypedRow, expected: Sequence[float], within: float) -> TypingSlip | None:
    """Return the slip that explains a row, or None.

    It is the nearest one of the likeliest kind.
    """
    for tried in (_exchanged(row), _in_another_unit(row), *_single(row)):
        fitting = [slip for slip in tried if apart(slip.meant, expected) <= within]
        if fitting:
            return min(fitting, key=lambda slip: apart(slip.meant, expected))
    return None


def apart(one: Sequence[float], other: Sequence[float]) -> float:
    """Return the largest difference of two rows."""
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def _exchanged(row: TypedRow) -> Iterator[TypingSlip]:
    for i, j in combinations(range(len(row.values)), 2):
        meant = list(row.values)
        meant[i], meant[j] = meant[j], meant[i]
        yield TypingSlip("order", i, tuple(meant))


def _in_another_unit(row: TypedRow) -> Iterator[TypingSlip]:
    for factor in _UNITS:
        yield TypingSlip("unit", None, tuple(factor * value for value in row.values))


def _single(row: TypedRow) -> tuple[list[TypingSlip], ...]:
    """Return every slip in one number, by kind, the likeliest first."""
    kinds = (("sign", _signs), ("swap", _swaps), ("point", _points), ("digit", _digits))
    return tuple(
        [
            TypingSlip(reason, i, (*row.values[:i], float(other), *row.values[i + 1 :]))
            for i, text in enumerate(row.texts)
            for other in others(text)
        ]
        for reason, others in kinds
    )


def _signs(text: str) -> Iterator[str]:
    yield text.lstrip("+-") if text.startswith("-") else f"-{text.lstrip('+')}"


def _swaps(text: str) -> Iterator[str]:
    for i in range(len(text)):
        j = i + 2 if text[i + 1 : i + 2] == "." else i + 1
        if j < len(text) and text[i].isdigit() and text[j].isdigit():
            yield f"{text[:i]}{text[j]}{text[i + 1 : j]}{text[i]}{text[j + 1 :]}"


def _points(text: str) -> Iterator[str]:
    for power in (-3, -2, -1, 1, 2, 3):
        yield repr(float(text) * 10.0**power)


def _digits(text: str) -> Iterator[str]:
    for i, sign in enumerate(text):
        for digit in "0123456789":
            yield f"{text[:i]}{digit}{text[i:]}" if sign not in "+-" else text
            if sign.isdigit():
                yield f"{text[:i]}{digit}{text[i + 1 :]}"
        if sign.isdigit() and sum(map(str.isdigit, text)) > 1:
            yield f"{text[:i]}{text[i + 1 :]}"
