"""Files in a folder that a program writes meanwhile: one that it removes while they are looked at is none of them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


def looked_at(folder: Path, look: Callable[[Path], T]) -> dict[Path, T]:
    """What `look` says of every file and folder below this one, and of itself."""
    found: dict[Path, T] = {}
    for path in (folder, *folder.rglob("*")):
        with suppress(FileNotFoundError):
            found[path] = look(path)
    return found
