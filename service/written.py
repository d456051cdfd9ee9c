"""Record of the files that this program has written.

A command replaces other files only with `--overwrite`. For each file that a command writes, its hash and the command
are kept under the hash of its path, in the user's state folder. This distinguishes a file that a person created or
changed, or that another command wrote, from one that the command may write again. If nothing can be kept, or on another
computer, the program's own files count as foreign; `--overwrite` then replaces them.
"""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from pathlib import Path

command: str = "truepose"  # the current command
overwriting: bool = False  # whether it may replace any file
# Path of a file that the current command will write -> the command and its option
_writers: dict[str, str] = {}
_MOST = 512 * 1024 * 1024  # bytes; a larger file is not read and counts as foreign


def remember(path: Path, data: bytes) -> None:
    """Record the content of a file that was written.

    If that is not possible, the file counts as foreign from now on.
    """
    with suppress(OSError):
        note = _note(path)
        note.parent.mkdir(parents=True, exist_ok=True)
        writer = _writers.get(os.path.realpath(path), "")
        note.write_text(f"{hashlib.sha256(data).hexdigest()} {writer}", "utf-8")


def intend(path: Path, writer: str) -> None:
    """State which command, by which option, will write a file."""
    _writers[os.path.realpath(path)] = writer


def writer_of(path: Path) -> str | None:
    """Return the command and option that wrote the current content of a file.

    The result is empty if the writer was not stated, and None if no command wrote the content.
    """
    try:
        if path.stat().st_size > _MOST:
            return None
        kept, _, writer = _note(path).read_text("utf-8").partition(" ")
        return writer if kept == hashlib.sha256(path.read_bytes()).hexdigest() else None
    except OSError:
        return None


def changed_since(path: Path) -> bool:
    """Return whether a command wrote a file that was changed since."""
    return path.exists() and _note(path).exists() and writer_of(path) is None


def _note(path: Path) -> Path:
    state = os.environ.get("LOCALAPPDATA" if os.name == "nt" else "XDG_STATE_HOME")
    folder = Path(state) if state else Path.home() / ".local" / "state"
    return (
        folder / "truepose" / "written" / hashlib.sha256(os.fsencode(os.path.realpath(path))).hexdigest()[:32]
    )
