"""The path under which the interface answers."""

from __future__ import annotations

PREFIX = "/api/v1"


def path_of(*parts: str) -> str:
    """Build the path of a resource for `Location` and links, such as `path_of("runs", run_id)`."""
    return "/".join((PREFIX, *parts))
