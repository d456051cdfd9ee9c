"""Tokens of the cells of a plant, one each, with a role, to be taken away one by one.

The file holds the SHA-256 of each token, not the token: who reads it can send nothing. It is read anew whenever it has
changed, so that a token taken away is worth nothing from the next request on. A file that cannot be used lets nobody
in.
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
    """One token. name: of the cell, or of who reads; role: "cell" puts documents in under its name, "viewer" reads;
    sha256: of the token, 64 hexadecimal digits; made: day, "2026-03-02"; robots: of which it may send documents, of all
    where it names none."""

    name: str
    role: May
    sha256: str
    made: str
    robots: tuple[RobotKey, ...] = ()

    def __post_init__(self) -> None:
        """Raises DataError for what is no entry."""
        if self.role not in get_args(May):
            raise DataError(f"is {self.role!r}.", do="Give cell or viewer.", key="role")
        name = self.name
        if not name.strip() or name != name.strip() or len(name) > LONGEST or not name.isprintable():
            raise DataError(f"{name!r} is no name.", do=f"Give {LONGEST} letters at most.", key="name")
        if self.robots and self.role != "cell":
            raise DataError(
                "goes with the role cell: a viewer reads of all.", do="Leave it out.", key="--robot"
            )


def robots_of(names: Sequence[str]) -> tuple[RobotKey, ...]:
    """The robots that are meant by "TYPE:SERIAL". Raises DataError."""
    parts = [name.partition(":") for name in names]
    for name, (model, _, serial) in zip(names, parts, strict=True):
        if not model or not serial:
            raise DataError(
                f"is {name!r}.", do="Give TYPE:SERIAL, such as abb-irb120:120-4711.", key="--robot"
            )
    return tuple(RobotKey(serial, model) for model, _, serial in parts)


def read_tokens(file: Path) -> list[OwnToken]:
    """The tokens of a file; none where there is no file. Raises DataError where others may read it, or it is none."""
    if not file.exists():
        return []
    table = parse_json(read_secret(file, "see who may send").encode(), file)
    if not isinstance(table, dict) or table.get("format") != FORMAT:
        raise DataError(
            f"is no {FORMAT}.", do="Make one: truepose fleet token add NAME --file FILE", file=file
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
        raise DataError(f"is damaged ({error}).", do="Make it anew; cells wait.", file=file) from error


def write_tokens(file: Path, tokens: Sequence[OwnToken]) -> None:
    """Replace the file at once, whole, readable by its owner alone where `service.private.owner_only` is in force."""
    table = {"format": FORMAT, "tokens": [asdict(each) for each in tokens]}
    replace_file(file, json.dumps(table, indent=1) + "\n")


def issue(file: Path, name: str, role: May, made: str, robots: tuple[RobotKey, ...] = ()) -> str:
    """A new token for a name; it is returned once and cannot be read later. Raises DataError where the name has one."""
    known = read_tokens(file)
    if any(each.name == name for each in known):
        raise DataError(
            f"'{name}' has a token.", do="Take that away first: truepose fleet token revoke", file=file
        )
    token = secrets.token_urlsafe(32)
    write_tokens(file, [*known, OwnToken(name, role, _digest(token), made, robots)])
    return token


def allow(file: Path, name: str, robots: tuple[RobotKey, ...]) -> None:
    """Let the token of a name name these robots too. Raises DataError where it has none."""
    found, others = _named(file, name)
    write_tokens(file, [*others, replace(found, robots=tuple(dict.fromkeys((*found.robots, *robots))))])


def revoke(file: Path, name: str) -> None:
    """Take the token of a name away. Raises DataError where it has none."""
    write_tokens(file, _named(file, name)[1])


def _named(file: Path, name: str) -> tuple[OwnToken, list[OwnToken]]:
    """The token of a name, and the others. Raises DataError where it has none."""
    known = read_tokens(file)
    for i, each in enumerate(known):
        if each.name == name:
            return each, known[:i] + known[i + 1 :]
    names = ", ".join(each.name for each in known) or "nobody"
    raise DataError(f"'{name}' has no token.", do=f"Those who have one: {names}.", file=file)


class Senders:
    """The senders known to a plant's server: the tokens of its start, and those of a file where there is one.

    With a file the token that all cells share puts nothing in any more: whoever had it could send under any name.
    """

    def __init__(self, shared: Tokens, file: Path | None = None) -> None:
        """The tokens that may send: `shared`, those of the start, and those of the cells' own in `file`. Raises
        DataError for a file that cannot be used.
        """
        self._shared, self._file = shared, file
        self._lock = threading.Lock()
        self._stamp, self._known = self._stamped(), {}
        if file is not None:
            self._known = {each.sha256: each for each in read_tokens(file)}

    def role_of(self, token: str) -> Role | None:
        """The role of a token; None if it is unknown."""
        role = self._shared.role_of(token)
        if self._file is None or role is Role.VIEWER:
            return role
        own = self.own(token)
        return None if own is None else _ROLES[own.role]

    def of_any_robot(self) -> list[str]:
        """The cells whose own tokens name no robots."""
        with self._lock:
            return [each.name for each in self._known.values() if each.role == "cell" and not each.robots]

    def own(self, token: str) -> OwnToken | None:
        """The entry of a token of somebody's own; None for one that all share."""
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
        """A stamp that changes with the file."""
        if self._file is None:
            return ()
        try:
            found = self._file.stat()
        except OSError:
            return ()
        return (found.st_mtime_ns, found.st_size, found.st_ino, found.st_mode)


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
