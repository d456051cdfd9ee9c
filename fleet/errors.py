"""Refusals of a store. The place (`file`) is the address of the store, without its password."""

from __future__ import annotations

from calib.errors import DataError


class StoreError(DataError):
    """A store that cannot be used as it is: none of ours, of another version, without the right, damaged."""


class StoreGone(StoreError):
    """A store that cannot be reached, or cannot keep anything at this moment: the same may be asked again later.

    Nothing of what was asked was kept.
    """


class StoreFull(StoreGone):
    """A store whose disk has no room left."""
