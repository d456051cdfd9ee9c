"""Errors of a store. The place (`file`) is the address of the store, without its password."""

from __future__ import annotations

from calib.errors import DataError


class StoreError(DataError):
    """A store that cannot be used.

    It is another program's, has another version, denies the right, or is damaged.
    """


class StoreGone(StoreError):
    """A store that cannot be reached, or cannot keep data now; the call may be repeated later.

    No part of the request was kept.
    """


class StoreFull(StoreGone):
    """A store whose disk is full."""
