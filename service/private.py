"""Private files, which nobody else on this computer may read: records, and the files that hold tokens.

Modes are those of POSIX; on Windows the folder's access list decides, which a folder below the user's own inherits.
"""

from __future__ import annotations

import os
import re
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calib.errors import DataError
from calib.text import read_bytes

_POSIX = os.name == "posix"
_OTHERS = stat.S_IRWXG | stat.S_IRWXO
_MOST_BYTES = 65536


@contextmanager
def owner_only() -> Iterator[None]:
    """Files made within get mode 0600 and folders 0700, also those of SQLite and of processes begun within.

    It is the umask of the whole process; also a decorator for a command.
    """
    before = os.umask(_OTHERS)
    try:
        yield
    finally:
        os.umask(before)


def note_if_others_read(folder: Path) -> None:
    """Say on standard error when the modes of a folder that was there before let others at it; they are left alone."""
    if _POSIX and folder.is_dir() and folder.stat().st_mode & _OTHERS:
        sys.stderr.write(
            f"truepose: others on this computer can read {folder}. What is written now they cannot; "
            f"for the whole of it: chmod -R go= {folder}\n"
        )


def refuse_foreign(path: Path, form: str) -> None:
    """Refuse a file that is to be replaced, and was not written by a service. form: a pattern of what one writes; an
    empty file is one whose writer was killed. Raises DataError."""
    if path.is_symlink() or path.exists():
        text = path.read_bytes()[:_MOST_BYTES].decode("utf-8", "replace") if path.is_file() else ""
        if path.is_symlink() or not path.is_file() or (text and not re.fullmatch(form, text)):
            raise DataError(
                "was not written by a service, which keeps a file of this name.",
                do="Move it, or give another folder with --record.",
                file=path,
            )


def make_secret(path: Path, text: str) -> None:
    """Write a new file that nobody else can read at any moment. Raises FileExistsError."""
    with open(path, "x", encoding="utf-8", opener=_open) as file:
        file.write(text)


def read_secret(path: Path, harm: str = "move the robot") -> str:
    """The text of a file. harm: what whoever reads it can do. Raises DataError where others may read it, or it is no
    ordinary file of text."""
    data = read_bytes(path, _MOST_BYTES)
    if _POSIX and path.stat().st_mode & _OTHERS:
        raise DataError(
            f"can be read by others, and whoever reads it can {harm}.",
            do=f"Let nobody else read it: chmod 600 {path}",
            file=path,
        )
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise DataError(
            "is not UTF-8 text.", do="Write the token in plain letters and digits.", file=path
        ) from error


def _open(name: str, flags: int) -> int:
    return os.open(name, flags, 0o600)
