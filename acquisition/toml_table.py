"""A TOML table that refuses by file and key: every getter raises ConfigError saying what is needed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from calib.errors import DataError
from calib.header import FARTHEST_MM
from calib.toml_text import parse_toml, read_toml
from drivers.errors import ConfigError

Vector = tuple[float, float, float]


def table_of_file(path: Path) -> tuple[str, dict[str, Any]]:
    """Text and table of a TOML file. Raises ConfigError."""
    try:
        return read_toml(path)
    except DataError as error:
        raise ConfigError(str(error)) from error


def table_of_text(text: str, where: str) -> dict[str, Any]:
    """The table of TOML text that is kept in a record. Raises ConfigError."""
    try:
        return parse_toml(text, where)
    except DataError as error:
        raise ConfigError(str(error)) from error


class TomlTable:
    """The values of one table, where they come from, and the key under which they stand there."""

    def __init__(self, values: Mapping[str, Any], file: str, prefix: str = "") -> None:
        self.values, self.file, self.prefix = values, file, prefix

    def refuse(self, key: str, what: str) -> ConfigError:
        """The error to raise; `what` is a sentence about the value."""
        return ConfigError(f"{self.file}, key '{self.prefix}{key}': {what}")

    def only(self, known: Iterable[str]) -> None:
        """Refuse keys that nobody reads: a mistyped limit must not pass for a limit."""
        allowed = sorted(known)
        for key in self.values:
            if key not in allowed:
                raise self.refuse(key, f"is not known here; there are {', '.join(allowed)}.")

    def table(self, key: str) -> TomlTable:
        """A table below this one; absent: empty."""
        value = self.values.get(key, {})
        if not isinstance(value, Mapping):
            raise self.refuse(key, f"is {value!r}; make it a table.")
        return TomlTable(value, self.file, f"{self.prefix}{key}.")

    def tables(self, key: str) -> list[TomlTable]:
        """An array of tables; absent: none."""
        value = self.values.get(key, [])
        if not isinstance(value, Sequence) or not all(isinstance(each, Mapping) for each in value):
            raise self.refuse(key, f"is {value!r}; write [[{key}]] tables.")
        return [TomlTable(each, self.file, f"{self.prefix}{key}[{i}].") for i, each in enumerate(value)]

    def text(self, key: str, default: str | None = None, allowed: Sequence[str] | None = None) -> str:
        value = self.values.get(key, default)
        if value is None:
            raise self.refuse(key, "is missing.")
        if not isinstance(value, str) or not value or (allowed is not None and value not in allowed):
            wanted = "text" if allowed is None else " or ".join(repr(a) for a in allowed)
            raise self.refuse(key, f"is {value!r}; use {wanted}.")
        return value

    def flag(self, key: str, default: bool) -> bool:
        value = self.values.get(key, default)
        if not isinstance(value, bool):
            raise self.refuse(key, f"is {value!r}; use true or false.")
        return value

    def number(
        self, key: str, default: float | None = None, *, low: float = -math.inf, high: float = math.inf
    ) -> float:
        value = self.values.get(key, default)
        if value is None:
            raise self.refuse(key, "is missing.")
        if not _is_number(value) or not low <= value <= high:
            raise self.refuse(key, f"is {value!r}; give a number{_range(low, high)}.")
        return float(value)

    def whole(self, key: str, default: int | None = None, *, low: int = 0, high: int = 1_000_000) -> int:
        value = self.values.get(key, default)
        if value is None:
            raise self.refuse(key, "is missing.")
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.refuse(key, f"is {value!r}; give a whole number{_range(low, high)}.")
        return value

    def vector(self, key: str) -> Vector:
        value = self.values.get(key)
        if not _are_numbers(value, 3):
            raise self.refuse(key, f"is {value!r}; give three numbers, [x, y, z].")
        x, y, z = value  # type: ignore[misc]
        if max(abs(x), abs(y), abs(z)) > FARTHEST_MM:
            raise self.refuse(key, f"is {value!r}, farther than anything on earth; give it in mm.")
        return float(x), float(y), float(z)

    def vectors(self, key: str) -> dict[str, Vector]:
        """Named points, `{ T1 = [x, y, z], ... }`; absent: none."""
        table = self.table(key)
        return {name: table.vector(name) for name in table.values}

    def rows(self, key: str, width: int, default: Sequence[Sequence[float]] = ()) -> list[tuple[float, ...]]:
        """A list of rows of `width` numbers."""
        value = self.values.get(key, default)
        if not isinstance(value, Sequence) or not all(_are_numbers(row, width) for row in value):
            raise self.refuse(key, f"is {value!r}; give a list of rows of {width} numbers.")
        return [tuple(float(x) for x in row) for row in value]

    def numbers(self, key: str) -> tuple[float, ...] | None:
        """A list of numbers, not empty; absent: None."""
        value = self.values.get(key)
        if value is None:
            return None
        if not isinstance(value, list | tuple) or not value or not _are_numbers(value, len(value)):
            raise self.refuse(key, f"is {value!r}; give a list of numbers.")
        return tuple(float(x) for x in value)

    def names(self, key: str) -> tuple[str, ...] | None:
        """A list of names, each once, not empty; absent: None."""
        value = self.values.get(key)
        if value is None:
            return None
        good = isinstance(value, list | tuple) and all(isinstance(name, str) and name for name in value)
        if not good or not value or len(set(value)) != len(value):
            raise self.refuse(key, f"is {value!r}; list names of {key}, each once.")
        return tuple(value)

    def words(
        self, key: str, allowed: Sequence[str], default: Sequence[str] | None = None
    ) -> tuple[str, ...]:
        """A list of names out of `allowed`, each at most once, not empty."""
        value = self.values.get(key, default)
        good = isinstance(value, Sequence) and not isinstance(value, str) and len(value) > 0
        if not good or any(word not in allowed for word in value) or len(set(value)) != len(value):  # type: ignore[union-attr, arg-type]
            raise self.refuse(key, f"is {value!r}; list some of {', '.join(allowed)}, each once.")
        return tuple(value)  # type: ignore[arg-type]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _are_numbers(value: object, count: int) -> bool:
    return isinstance(value, list | tuple) and len(value) == count and all(_is_number(x) for x in value)


def _range(low: float, high: float) -> str:
    if math.isfinite(low) and math.isfinite(high):
        return f" from {low:g} to {high:g}"
    if math.isfinite(low):
        return f", {low:g} or above"
    return f", {high:g} or below" if math.isfinite(high) else ""
