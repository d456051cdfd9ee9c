"""The file that holds the tokens of a service: the operator's in its first line, the viewer's in its second.

Without a choice of the user it lies in the record, is made anew at every start and removed at the end. A file that the
user names keeps its tokens for good; where it is not there it is made.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from calib.errors import DataError
from service.http.access.roles import Tokens
from service.private import make_secret, read_secret, refuse_foreign

NAME = "tokens"
VARIABLE = "TRUEPOSE_TOKEN"
SHORTEST = 16


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
