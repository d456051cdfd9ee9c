"""Refusal of unusual values in JSON and TOML: huge integers, NaN, deep nesting."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from calib.errors import DataError

DEEPEST = 32
"""Tables and lists within one another; our own files have six."""
LONGEST_TEXT = 1024 * 1024
"""Characters of one text, key or attribute of a file."""
LARGEST_INTEGER = 2**63
"""As TOML: more is no count of anything, and no float holds it."""


def refuse_unusual(value: Any, file: Path | str | None = None, *, longest: float = math.inf) -> None:
    """Raise DataError for a value that is nested too deeply, too large an integer or not finite.

    The error names the key. `longest` is the largest number of characters of a text or a key.
    """
    waiting: list[tuple[str, Any, int]] = [("", value, 0)]
    while waiting:  # not by recursion, which deep nesting would exhaust
        key, each, depth = waiting.pop()
        # The three are distinguished by their exact kinds, which is quick: a model file holds some 10,000 numbers.
        if isinstance(each, dict):
            if any(len(name) > longest for name in each):
                raise too_long(file)
            waiting += [
                (f"{key}.{name}" if key else str(name), item, depth + 1) for name, item in each.items()
            ]
        elif isinstance(each, list):
            waiting += [(key, item, depth + 1) for item in each]
        elif isinstance(each, str):
            if len(each) > longest:
                raise too_long(file)
        elif isinstance(each, int) and abs(each) >= LARGEST_INTEGER:
            raise DataError(
                "has an integer of more than 64 bits.", do="Correct it.", file=file, key=key or None
            )
        elif isinstance(each, float) and not math.isfinite(each):
            do = "Give a finite number, or leave it out."
            raise DataError(f"is {each}.", do=do, file=file, key=key or None)
        if depth > DEEPEST:
            raise too_deep(file)


def too_long(file: Path | str | None, line: int | None = None) -> DataError:
    """Build the error for a text that is too long for any reading."""
    what = f"holds a single text or attribute of more than {LONGEST_TEXT // 2**20} MB."
    return DataError(what, do="Check whether it is the file that was meant.", file=file, line=line)


def too_deep(file: Path | str | None) -> DataError:
    """Build the error for values that are nested too deeply."""
    return DataError(f"is nested more than {DEEPEST} deep.", do="Correct its brackets.", file=file)
