"""Record of the files that this program has written.

A command replaces other files only with `--overwrite`. For each file that a command writes, its hash and the command
are kept under the hash of its path, in the user's state folder. This distinguishes a file that a person created or
changed, or that another command wrote, from one that the command may write again. If nothing can be kept, or on another
computer, the program's own files count as foreign; `--overwrite` then replaces them.

The note is made before the file is replaced, and still has the content before: a program that is killed in between
knows its file again, whichever of the two it is.
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
_added_to: set[str] = set()  # those of these paths that keep their content
_done: dict[str, str] = {}  # path of a file that this process wrote -> its hash
_MOST = 512 * 1024 * 1024  # bytes; a larger file is not read and counts as foreign


def remember(path: Path, data: bytes) -> None:
    """Record the content with which a file is about to be replaced.

    If that is not possible, the file counts as foreign in later programs.

    Raises
    ------
    DataError
        The file is one that a command stated (`intend`), and its content now is of another.
    """
    place = os.path.realpath(path)
    writer, now = _writers.get(place), _sha256(path)
    stated = writer is not None and place not in _added_to and not overwriting
    if stated and now not in (None, _done.get(place)) and writer_of(path) not in ("", writer):
        from calib.errors import DataError  # not for a program that only shows its help

        raise DataError(
            "was put there by another program meanwhile.",
            do="Move it, then give the command again.",
            file=path,
        )
    _done[place] = hashlib.sha256(data).hexdigest()
    note = _note(path)
    with suppress(OSError):
        note.parent.mkdir(parents=True, exist_ok=True)
        lines = note.read_text("utf-8").splitlines() if now and note.exists() else []
        before = [line for line in lines if line.partition(" ")[0] == now]
        partial = note.with_name(f"{note.name}.{os.getpid()}")
        try:
            partial.write_text("\n".join([f"{_done[place]} {writer or ''}", *before[:1]]), "utf-8")
            os.replace(partial, note)
        finally:
            partial.unlink(missing_ok=True)


def intend(path: Path, writer: str, *, added_to: bool = False) -> None:
    """State which command, by which option, will write a file; with `added_to`, it keeps the content."""
    _writers[os.path.realpath(path)] = writer
    (_added_to.add if added_to else _added_to.discard)(os.path.realpath(path))


def writer_of(path: Path) -> str | None:
    """Return the command and option that wrote the current content of a file.

    The result is empty if the writer was not stated, and None if no command wrote the content.
    """
    now = _sha256(path)
    try:
        for line in _note(path).read_text("utf-8").splitlines():
            kept, _, writer = line.partition(" ")
            if kept == now:
                return writer
    except OSError:
        pass
    return None


def _sha256(path: Path) -> str | None:
    """Return the hash of a file; None if there is none, empty if it cannot be read or is too large."""
    try:
        return "" if path.stat().st_size > _MOST else hashlib.sha256(path.read_bytes()).hexdigest()
    except FileNotFoundError:
        return None
    except OSError:
        return ""


def changed_since(path: Path) -> bool:
    """Return whether a command wrote a file that was changed since."""
    return path.exists() and _note(path).exists() and writer_of(path) is None


def _note(path: Path) -> Path:
    state = os.environ.get("LOCALAPPDATA" if os.name == "nt" else "XDG_STATE_HOME")
    folder = Path(state) if state else Path.home() / ".local" / "state"
    return (
        folder / "truepose" / "written" / hashlib.sha256(os.fsencode(os.path.realpath(path))).hexdigest()[:32]
    )
