"""Refusal of true and false in the place of numbers.

Python counts true as 1, and an angle of true would be one degree.
"""

from __future__ import annotations

from pathlib import Path

from calib.errors import DataError


def refuse_flags(value: object, file: Path | str, key: str) -> None:
    """Raise DataError for a true or false anywhere in the value of `key` of a TOML file.

    The error names the key.
    """
    if isinstance(value, bool):
        raise DataError(f"is {str(value).lower()}.", do="Give a number.", file=file, key=key)
    if isinstance(value, dict):
        for name, below in value.items():
            refuse_flags(below, file, f"{key}.{name}" if key else name)
    if isinstance(value, list):
        for number, below in enumerate(value, start=1):
            refuse_flags(below, file, f"{key}[{number}]")
