"""Ids of resources: sortable by time, safe as the name of a folder and in a URL."""

from __future__ import annotations

import re
import secrets
from datetime import UTC, datetime

_SAFE = re.compile(r"[0-9A-Za-z][0-9A-Za-z-]{0,63}")


def new_id() -> str:
    """A new name such as `20261121-170459-3f9a1c07b2e`: day, time of day, microseconds and chance."""
    now = datetime.now(UTC)
    return f"{now:%Y%m%d-%H%M%S}-{now.microsecond:05x}{secrets.token_hex(3)}"


def safe_id(name: str) -> bool:
    """Whether a name cannot lead out of its folder, whatever a client sends."""
    return _SAFE.fullmatch(name) is not None


def plain_name(given: str) -> str:
    """The name of a file that a client sends, as one that any system keeps: no folders, at most 80 letters."""
    last = given.replace("\\", "/").rsplit("/", 1)[-1]
    kept = re.sub(r"[^\w. ()+-]", "_", last).strip(" .")
    return kept[-80:].lstrip(" .") or "file"
