"""Private files, which other users of this computer may not read: records and token files.

Access is restricted by POSIX modes. On Windows the access list of the folder decides; a folder below the user's profile
inherits it.

A token file holds the operator's token in its first line and the viewer's token in its second line. By default it is in
the record folder, is created at every start and is removed at the end. A file that the user names keeps its tokens
permanently; it is created if it does not exist.
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
    """Give files that are created in this block mode 0600, and folders 0700.

    This includes the files of SQLite and of child processes, because the umask of the whole process is set. It can also
    decorate a command.
    """
    before = os.umask(_OTHERS)
    try:
        yield
    finally:
        os.umask(before)


def note_if_others_read(folder: Path) -> None:
    """Print a note on standard error if other users can read an existing folder.

    The modes of the folder are not changed.
    """
    if _POSIX and folder.is_dir() and folder.stat().st_mode & _OTHERS:
        sys.stderr.write(
            f"truepose: others on this computer can read {folder}. What is written now they cannot; "
            f"for the whole of it: chmod -R go= {folder}\n"
        )


def refuse_foreign(path: Path, form: str) -> None:
    """Refuse to replace a file that was not written by a service.

    Parameters
    ----------
    form : str
        Regular expression of the text that a service writes. An empty file is accepted: its writer was killed.

    Raises
    ------
    DataError
        The file is a link, is not an ordinary file, or has other text.
    """
    if path.is_symlink() or path.exists():
        text = path.read_bytes()[:_MOST_BYTES].decode("utf-8", "replace") if path.is_file() else ""
        if path.is_symlink() or not path.is_file() or (text and not re.fullmatch(form, text)):
            raise DataError(
                "was not written by a service, which keeps a file of this name.",
                do="Move it, or give another folder with --record.",
                file=path,
            )


def make_secret(path: Path, text: str) -> None:
    """Write a new file that other users cannot read at any moment.

    Raises
    ------
    FileExistsError
        The file exists already.
    """
    with open(path, "x", encoding="utf-8", opener=_open) as file:
        file.write(text)


def read_secret(path: Path, harm: str = "move the robot") -> str:
    """Read the text of a private file.

    Parameters
    ----------
    harm : str
        Action that the secret permits, for the error message.

    Raises
    ------
    DataError
        Other users may read the file, or it is not an ordinary text file in UTF-8.
    """
    data = read_bytes(path, _MOST_BYTES)
    if _POSIX and path.stat().st_mode & _OTHERS:
        raise DataError(
            f"can be read by others, and a person who reads it can {harm}.",
            do=f"Let only its owner read it: chmod 600 {path}",
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
    """Return the operator's token from the environment, or None if it is not set.

    Raises
    ------
    DataError
        The token is not usable.
    """
    text = os.environ.get(VARIABLE, "").strip()
    return _usable(text, key=VARIABLE) if text else None


@contextmanager
def tokens_until_the_end(record: Path, operator: str | None) -> Iterator[Tokens]:
    """Create the tokens of one start and keep them in a file in the record during the block."""
    tokens = _new(operator)
    record.mkdir(parents=True, exist_ok=True)
    file, text = record / NAME, _text(tokens)
    refuse_foreign(file, r"(?:[!-~]+\n){2}")
    file.unlink(missing_ok=True)  # of a service that was killed
    make_secret(file, text)
    try:
        yield tokens
    finally:
        with suppress(OSError):  # it is missing, or cannot be removed: its tokens are no longer valid
            if file.read_text(encoding="utf-8") == text:  # not the file of a service that started later
                file.unlink()


def lasting_tokens(file: Path, first: str = "operator's", harm: str = "move the robot") -> Tokens:
    """Read the tokens from a file that the user named; create it if it does not exist.

    If the file has only one line, a new viewer's token is created for this start.

    Parameters
    ----------
    first : str
        Owner of the first token, for error messages.
    harm : str
        Action that the first token permits, for error messages.

    Raises
    ------
    DataError
        Other users may read the file, or it does not hold one or two different usable tokens.
    """
    if not os.path.lexists(file):  # a dangling link is refused below
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
            do="Use two different tokens.",
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
