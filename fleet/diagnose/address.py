"""Addresses: of a scheduler, and of a store as workers can use it."""

from __future__ import annotations

from ipaddress import ip_address
from pathlib import Path
from urllib.parse import SplitResult, urlsplit

import sqlalchemy as sa
from sqlalchemy import exc

from calib.errors import DataError


def is_elsewhere(scheduler: str) -> bool:
    """Whether the scheduler of this address is on another computer, as far as the address says."""
    host = _parts(scheduler).hostname or ""
    try:
        return not ip_address(host).is_loopback
    except ValueError:
        return host != "localhost"


def exposed(scheduler: str) -> bool:
    """Whether what goes to this scheduler leaves the computer without TLS."""
    return _parts(scheduler).scheme != "tls" and is_elsewhere(scheduler)


def for_workers(store: str, scheduler: str) -> str:
    """The address of a store for processes that begin in other folders; scheduler: "" for those of this computer.

    Raises DataError for an SQLite file and workers elsewhere, who have no file of this name, or another one.
    """
    try:
        url = sa.make_url(store)
    except exc.ArgumentError:  # refused by the store itself, in its words
        return store
    if url.get_backend_name() != "sqlite" or not url.database:
        return store
    if scheduler and is_elsewhere(scheduler):
        raise DataError(
            "is a file of this computer, which workers elsewhere cannot write to.",
            do="Give a PostgreSQL, or leave --scheduler out.",
            key="--store",
        )
    return url.set(database=str(Path(url.database).absolute())).render_as_string(hide_password=False)


def _parts(scheduler: str) -> SplitResult:
    return urlsplit(scheduler if "://" in scheduler else f"tcp://{scheduler}")
