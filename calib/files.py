"""Files that are whole or not there: written beside their place first, synced, then renamed."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

MODE = 0o644  # less what the umask takes away


def replace_file(path: Path, text: str) -> None:
    """Write a UTF-8 text file whole or not at all; of a symlink the file it points to."""
    target = Path(os.path.realpath(path))
    # A name of its own for every writer: two of them at once do not spoil each other's file.
    partial = target.with_name(f"{target.stem[:40]}.{secrets.token_hex(6)}.partial")
    try:
        with open(partial, "x", encoding="utf-8", newline="\n", opener=_open) as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, target)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def _open(name: str, flags: int) -> int:
    return os.open(name, flags, MODE)
