"""Private files, which nobody else on this computer may read: records, and the files that hold tokens.

Modes are those of POSIX; on Windows the folder's access list decides, which a folder below the user's own inherits.

The file that holds the tokens of a service: the operator's in its first line, the viewer's in its second.

Without a choice of the user it lies in the record, is made anew at every start and removed at the end. A file that the
user names keeps its tokens for good; where it is not there it is made.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from calib.errors import DataError
from calib.text import read_bytes
from service.http.access.roles import Tokens

_POSIX = os.name == "posix"
_OTHERS = stat.S_IRWXG | stat.S_IRWXO
_MOST_BYTES = 65536
NAME = "tokens"
VARIABLE = "TRUEPOSE_TOKEN"
SHORTEST = 16


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


def chosen_token() -> str | None:
    """The operator's token from the environment; None where there is none. Raises DataError."""
    text = os.environ.get(VARIABLE, "").strip()
    return _usable(text, key=VARIABLE) if text else None


@contextmanager
def tokens_until_the_end(record: Path, operator: str | None) -> Iterator[Tokens]:
    """Tokens of one start, in a new file in the record for as long as the block lasts."""
    tokens = _new(operator)
    record.mkdir(parents=True, exist_ok=True)
    file, text = record / NAME, _text(tokens)
    refuse_foreign(file, r"(?:[!-~]+\n){2}")
    file.unlink(missing_ok=True)  # of a service that was killed
    make_secret(file, text)
    try:
        yield tokens
    finally:
        with suppress(OSError):  # it is gone, or cannot be removed: its tokens are worth nothing any more
            if file.read_text(encoding="utf-8") == text:  # not that of a service begun since
                file.unlink()


def lasting_tokens(file: Path, first: str = "operator's", harm: str = "move the robot") -> Tokens:
    """The tokens in the user's own file, which is made where it is not there; without a second line a new viewer's.

    first: whose the first is; harm: what whoever has it can do.
    Raises DataError where others may read the file or it holds no usable token.
    """
    if not os.path.lexists(file):  # a link that leads nowhere is refused below
        tokens = _new(None)
        make_secret(file, _text(tokens))
        return tokens
    lines = [line.strip() for line in read_secret(file, harm).splitlines() if line.strip()]
    if len(lines) > 2:
        raise DataError(
            "has more than two lines.", do=f"Give the {first} token, then the viewer's.", file=file
        )
    usable = [_usable(line, file=file) for line in lines or [""]]
    if len(usable) == 1:
        return _new(usable[0])
    if usable[0] == usable[1]:
        raise DataError(
            "has the same token in both lines.",
            do="Use two different ones.",
            file=file,
            line=2,
        )
    return Tokens(*usable)


def _new(operator: str | None) -> Tokens:
    return Tokens(operator or secrets.token_urlsafe(32), secrets.token_urlsafe(32))


def _text(tokens: Tokens) -> str:
    return f"{tokens.operator}\n{tokens.viewer}\n"


def _usable(text: str, *, file: Path | None = None, key: str | None = None) -> str:
    if len(text) < SHORTEST or not text.isascii() or not text.isprintable() or " " in text:
        raise DataError(
            "is not a usable token.",
            do=f"Use at least {SHORTEST} letters, digits and signs, without spaces.",
            file=file,
            key=key,
        )
    return text
