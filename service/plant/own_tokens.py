"""Tokens of the cells of a plant, one each, with a role, which can be revoked one by one.

The file holds the SHA-256 of each token, not the token: a person who reads it can send nothing. It is read
again whenever it has changed, so that a revoked token is invalid from the next request on. With a file that
cannot be used, no client is let in.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import sys
import threading
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal, get_args

from calib.errors import DataError
from calib.text import parse_json, replace_file
from fleet.store import LONGEST, RobotKey
from service.http.access.roles import Role, Tokens
from service.private import read_secret

FORMAT = "truepose-fleet-tokens/1"
May = Literal["cell", "viewer"]
_ROLES = {"cell": Role.OPERATOR, "viewer": Role.VIEWER}


@dataclass(frozen=True)
class OwnToken:
    """One token.

    Attributes
    ----------
    name : str
        Name of the cell or the viewer.
    role : May
        "cell" puts documents in under its name; "viewer" reads.
    sha256 : str
        SHA-256 of the token, 64 hexadecimal digits.
    made : str
        Day, "2026-03-02".
    robots : tuple of RobotKey
        Robots whose documents it may send; empty for all.
    """

    name: str
    role: May
    sha256: str
    made: str
    robots: tuple[RobotKey, ...] = ()

    def __post_init__(self) -> None:
        """Refuse a wrong entry.

        Raises
        ------
        DataError
            A value cannot be used; the message names its key.
        """
        if self.role not in get_args(May):
            raise DataError(f"is {self.role!r}.", do="Give cell or viewer.", key="role")
        name = self.name
        if not name.strip() or name != name.strip() or len(name) > LONGEST or not name.isprintable():
            raise DataError(
                f"{name!r} is not a usable name.", do=f"Give {LONGEST} letters at most.", key="name"
            )
        if self.robots and self.role != "cell":
            raise DataError(
                "goes with the role cell: a viewer reads of all.", do="Leave it out.", key="--robot"
            )


def robots_of(names: Sequence[str]) -> tuple[RobotKey, ...]:
    """Return the robots that "TYPE:SERIAL" names.

    Raises
    ------
    DataError
        A name has another form.
    """
    parts = [name.partition(":") for name in names]
    for name, (model, _, serial) in zip(names, parts, strict=True):
        if not model or not serial:
            raise DataError(
                f"is {name!r}.", do="Give TYPE:SERIAL, such as abb-irb120:120-4711.", key="--robot"
            )
    return tuple(RobotKey(serial, model) for model, _, serial in parts)


def read_tokens(file: Path) -> list[OwnToken]:
    """Read the tokens of a file; none if there is no file.

    Raises
    ------
    DataError
        Other users may read the file, or it is no file of tokens.
    """
    if not file.exists():
        return []
    table = parse_json(read_secret(file, "see who may send").encode(), file)
    if not isinstance(table, dict) or table.get("format") != FORMAT:
        raise DataError(
            f"is not a file of the format {FORMAT}.",
            do="Make one: truepose fleet token add NAME --file FILE",
            file=file,
        )
    try:
        return [
            OwnToken(
                each["name"],
                each["role"],
                each["sha256"],
                each["made"],
                tuple(RobotKey(**robot) for robot in each.get("robots", ())),
            )
            for each in table["tokens"]
        ]
    except (KeyError, TypeError, AttributeError) as error:
        raise DataError(
            f"is damaged ({error}).",
            do="Create the file again; until then the cells keep their documents.",
            file=file,
        ) from error


def write_tokens(file: Path, tokens: Sequence[OwnToken]) -> None:
    """Replace the file of tokens atomically.

    Only its owner can read it where `service.private.owner_only` is in force.
    """
    table = {"format": FORMAT, "tokens": [asdict(each) for each in tokens]}
    replace_file(file, json.dumps(table, indent=1) + "\n")


def issue(file: Path, name: str, role: May, made: str, robots: tuple[RobotKey, ...] = ()) -> str:
    """Create a token for a name; it is returned once and cannot be read later.

    Raises
    ------
    DataError
        The name has a token.
    """
    known = read_tokens(file)
    if any(each.name == name for each in known):
        raise DataError(
            f"'{name}' has a token.", do="Revoke that token first: truepose fleet token revoke", file=file
        )
    token = secrets.token_urlsafe(32)
    write_tokens(file, [*known, OwnToken(name, role, _digest(token), made, robots)])
    return token


def allow(file: Path, name: str, robots: tuple[RobotKey, ...]) -> None:
    """Let the token of a name name these robots too.

    Raises
    ------
    DataError
        The name has no token.
    """
    found, others = _named(file, name)
    write_tokens(file, [*others, replace(found, robots=tuple(dict.fromkeys((*found.robots, *robots))))])


def revoke(file: Path, name: str) -> None:
    """Take the token of a name away.

    Raises
    ------
    DataError
        The name has no token.
    """
    write_tokens(file, _named(file, name)[1])


def _named(file: Path, name: str) -> tuple[OwnToken, list[OwnToken]]:
    """Return the token of a name, and the others.

    Raises
    ------
    DataError
        The name has no token.
    """
    known = read_tokens(file)
    for i, each in enumerate(known):
        if each.name == name:
            return each, known[:i] + known[i + 1 :]
    names = ", ".join(each.name for each in known) or "nobody"
    raise DataError(f"'{name}' has no token.", do=f"Tokens exist for: {names}.", file=file)


class Senders:
    """The senders known to a plant's server: tokens of its start, and those of a file.

    With a file, the token that all cells share puts nothing in any more, because any client that has it could send
    under any name.
    """

    def __init__(self, shared: Tokens, file: Path | None = None) -> None:
        """Read the cells' own tokens in `file`; `shared` are the tokens of the start.

        Raises
        ------
        DataError
            The file cannot be used.
        """
        self._shared, self._file = shared, file
        self._lock = threading.Lock()
        self._stamp, self._known = self._stamped(), {}
        if file is not None:
            self._known = {each.sha256: each for each in read_tokens(file)}

    def role_of(self, token: str) -> Role | None:
        """Return the role of a token; None if it is unknown."""
        role = self._shared.role_of(token)
        if self._file is None or role is Role.VIEWER:
            return role
        own = self.own(token)
        return None if own is None else _ROLES[own.role]

    def of_any_robot(self) -> list[str]:
        """Return the cells whose own tokens name no robots."""
        with self._lock:
            return [each.name for each in self._known.values() if each.role == "cell" and not each.robots]

    def own(self, token: str) -> OwnToken | None:
        """Return the entry of an individual token; None for one that all share."""
        with self._lock:
            stamp = self._stamped()
            if stamp != self._stamp:
                self._stamp, self._known = stamp, self._again()
            return self._known.get(_digest(token))

    def _again(self) -> dict[str, OwnToken]:
        assert self._file is not None
        try:
            return {each.sha256: each for each in read_tokens(self._file)}
        except (DataError, OSError) as error:
            sys.stderr.write(f"truepose: nobody may send until this is mended: {error}\n")
            return {}

    def _stamped(self) -> tuple[int, ...]:
        """Return a stamp that changes with the file."""
        if self._file is None:
            return ()
        try:
            found = self._file.stat()
        except OSError:
            return ()
        return (found.st_mtime_ns, found.st_size, found.st_ino, found.st_mode)


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
