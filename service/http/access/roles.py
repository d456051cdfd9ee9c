"""The two roles: a viewer reads everything, pauses and stops; an operator does everything.

It is decided by method and path in one place, so that a route somebody adds is the operator's until it is listed here.
"""

from __future__ import annotations

import hmac
import re
from dataclasses import dataclass, field
from enum import Enum

from service.http.wire.paths import PREFIX

_READS = ("GET", "HEAD")
_COMES_TO_REST = re.compile(rf"{PREFIX}/(runs|loops)/[^/]+/(pause|stop)")


class Role(Enum):
    """The role of the token that a request came with."""

    VIEWER = "viewer"
    OPERATOR = "operator"


@dataclass(frozen=True)
class Tokens:
    """The tokens of one service."""

    operator: str = field(repr=False)
    viewer: str = field(repr=False)

    def role_of(self, token: str) -> Role | None:
        """The role of a token; None if it is unknown. Compared in constant time."""
        given = token.encode()
        operator = hmac.compare_digest(given, self.operator.encode())
        viewer = hmac.compare_digest(given, self.viewer.encode())
        if operator:
            return Role.OPERATOR
        return Role.VIEWER if viewer else None


def viewer_may(method: str, path: str) -> bool:
    """Whether a request, or an operation of the description, is open to a viewer."""
    return method in _READS or (method == "POST" and _COMES_TO_REST.fullmatch(path) is not None)
