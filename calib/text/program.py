"""The name that this program signs its documents with."""

from __future__ import annotations

from functools import cache
from importlib import metadata


@cache
def written_by() -> str:
    """Return name and version, "truepose 0.1.0"."""
    return f"truepose {metadata.version('truepose')}"
