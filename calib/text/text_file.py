"""Text files of people and other programs: read completely or refused, written atomically.

All text files are read by `read_text`, which refuses folders, devices, files that are too large or not
UTF-8, each with the reason. A byte order mark is removed. Lines may end as on any system and end with LF
from here on.

Files are written atomically: a temporary file in the same folder is written, synced, then renamed.
"""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Callable
from pathlib import Path

from calib.errors import DataError

MOST_BYTES = 256 * 1024 * 1024
"""A million readings have some 200 MB."""

_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
MODE = 0o644  # less what the umask takes away
_noting: Callable[[Path, bytes], object] | None = None


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Read an ordinary file of at most `most` bytes.

    Raises
    ------
    DataError
        The file cannot be read, or is larger; the error names it.
    """
    try:
        # Without waiting: a named pipe without a writer would hold the program for ever.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except FileNotFoundError as error:
        raise DataError("there is no such file.", do="Check the name.", file=path) from error
    except PermissionError as error:
        what = "is a folder." if path.is_dir() else "may not be read by this user."
        raise DataError(what, do="Name a file that can be read.", file=path) from error
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise DataError(f"cannot be read ({why}).", do="Check the name.", file=path) from error
    mode = os.fstat(handle).st_mode
    if not stat.S_ISREG(mode):
        os.close(handle)
        what = "is a folder." if stat.S_ISDIR(mode) else "is not an ordinary file."
        raise DataError(what, do="Name a file on a disk.", file=path)
    with open(handle, "rb") as file:
        try:
            data = file.read(most + 1)
        except OSError as error:  # a disk that fails; a file of the system that only looks ordinary
            raise DataError(
                f"cannot be read ({error.strerror}).", do="Name another file, or check the disk.", file=path
            ) from error
    if len(data) > most:
        raise DataError(
            f"is larger than {most / 1024 / 1024:g} MB.", do="Split it, or check the name.", file=path
        )
    return data


def decoded(data: bytes, file: Path | str) -> str:
    """Decode UTF-8 text without its byte order mark.

    Raises
    ------
    DataError
        The bytes are not UTF-8 text; the error names the line if possible.
    """
    if data.startswith(_UTF_16):
        raise DataError("is UTF-16, not UTF-8.", do="Save it as UTF-8.", file=file)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise DataError("is not UTF-8 text.", do="Save it as UTF-8.", file=file, line=line) from error
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise DataError("holds a NUL byte: it is not text.", do="Save it as UTF-8.", file=file, line=line)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_text(path: Path, most: int = MOST_BYTES) -> str:
    """Read the text of a file.

    Raises
    ------
    DataError
        The file cannot be read, or is not UTF-8 text; the error names it.
    """
    return decoded(read_bytes(path, most), path)


def note_files(hook: Callable[[Path, bytes], object] | None) -> None:
    """Call `hook` with path and content just before every file that is written from now on is replaced.

    It may raise an error to keep the file as it is. None removes the hook.
    """
    global _noting
    _noting = hook


def replace_file(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all, text as UTF-8; of a symlink the file it points to."""
    data = content if isinstance(content, bytes) else content.encode("utf-8")
    target = Path(os.path.realpath(path))
    # A separate name for every writer, so that two of them at once do not spoil each other's file.
    partial = target.with_name(f"{target.stem[:40]}.{secrets.token_hex(6)}.partial")
    try:
        with open(partial, "xb", opener=_open) as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if _noting is not None:
            _noting(target, data)
        os.replace(partial, target)
    except BaseException as error:
        if isinstance(error, OSError):
            error.filename, error.filename2 = str(path), None  # not that of the part; a full disk names none
        partial.unlink(missing_ok=True)
        raise


def _open(name: str, flags: int) -> int:
    return os.open(name, flags, MODE)
