"""Ids of resources: sortable by time, safe as the name of a folder and in a URL."""

from __future__ import annotations

import re
import secrets
from datetime import UTC, datetime

_SAFE = re.compile(r"[0-9A-Za-z][0-9A-Za-z-]{0,63}")


def new_id() -> str:
    """Create an id such as `20261121-170459-3f9a1c07b2e`.

    It holds the UTC date and time, the microseconds and a random part.
    """
    now = datetime.now(UTC)
    return f"{now:%Y%m%d-%H%M%S}-{now.microsecond:05x}{secrets.token_hex(3)}"


def safe_id(name: str) -> bool:
    """Return whether a name that a client sent cannot lead out of its folder."""
    return _SAFE.fullmatch(name) is not None


def plain_name(given: str) -> str:
    """Turn the file name that a client sent into one that any system accepts.

    The result has no folders and at most 80 characters and 200 bytes; it is `file` if no character remains.
    """
    last = given.replace("\\", "/").rsplit("/", 1)[-1]
    kept = re.sub(r"[^\w. ()+-]", "_", last).strip(" .")
    return kept[-80:].encode()[-200:].decode(errors="ignore").lstrip(" .") or "file"
