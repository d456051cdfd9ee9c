"""Which files this program has written, as it left them: no command replaces any other, unless it is told to.

For each file that a command writes its hash and the command are kept under the hash of its path, in the user's state
folder. A file that somebody made or changed, or that another command wrote, is then told from one that the command may
make anew. Where nothing can be kept, or on another computer, our own files count as foreign, and `--overwrite` replaces
them.
"""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from pathlib import Path

command: str = "truepose"  # the command in hand
overwriting: bool = False  # whether it may replace any file
# Path of a file that the command in hand will write -> the command and its option
_writers: dict[str, str] = {}
_MOST = 512 * 1024 * 1024  # bytes of a file that is read to be known again


def remember(path: Path, data: bytes) -> None:
    """Keep what was written; where that is not possible, the file counts as somebody's own from now on."""
    with suppress(OSError):
        note = _note(path)
        note.parent.mkdir(parents=True, exist_ok=True)
        writer = _writers.get(os.path.realpath(path), "")
        note.write_text(f"{hashlib.sha256(data).hexdigest()} {writer}", "utf-8")


def intend(path: Path, writer: str) -> None:
    """State which command, by which option, will write a file."""
    _writers[os.path.realpath(path)] = writer


def writer_of(path: Path) -> str | None:
    """The command and the option that have left a file as it is; '' where it was not stated, None for no command."""
    try:
        if path.stat().st_size > _MOST:
            return None
        kept, _, writer = _note(path).read_text("utf-8").partition(" ")
        return writer if kept == hashlib.sha256(path.read_bytes()).hexdigest() else None
    except OSError:
        return None


def changed_since(path: Path) -> bool:
    """Whether a command has written a file, and somebody has changed it."""
    return path.exists() and _note(path).exists() and writer_of(path) is None


def _note(path: Path) -> Path:
    state = os.environ.get("LOCALAPPDATA" if os.name == "nt" else "XDG_STATE_HOME")
    folder = Path(state) if state else Path.home() / ".local" / "state"
    return (
        folder / "truepose" / "written" / hashlib.sha256(os.fsencode(os.path.realpath(path))).hexdigest()[:32]
    )
