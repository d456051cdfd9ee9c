"""The refusal of the engine that computes."""

from __future__ import annotations

from calib.errors import DataError


class EngineGone(DataError):
    """There is no scheduler, or no worker of the same build. Results so far are kept, and the call may be repeated."""
