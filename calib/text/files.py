"""Atomic writing of files: a temporary file beside the target is written, synced, then renamed."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable
from pathlib import Path

MODE = 0o644  # less what the umask takes away

_noting: Callable[[Path, bytes], object] | None = None


def note_files(hook: Callable[[Path, bytes], object] | None) -> None:
    """Call `hook` with every file that is written from now on, and what was written; None: call nothing."""
    global _noting
    _noting = hook


def replace_file(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all, text as UTF-8; of a symlink the file it points to."""
    data = content if isinstance(content, bytes) else content.encode("utf-8")
    target = Path(os.path.realpath(path))
    # A name of its own for every writer: two of them at once do not spoil each other's file.
    partial = target.with_name(f"{target.stem[:40]}.{secrets.token_hex(6)}.partial")
    try:
        with open(partial, "xb", opener=_open) as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, target)
        if _noting is not None:
            _noting(target, data)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def _open(name: str, flags: int) -> int:
    return os.open(name, flags, MODE)
