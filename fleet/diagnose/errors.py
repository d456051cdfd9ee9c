"""The refusal of the engine that computes."""

from __future__ import annotations

from calib.errors import DataError


class EngineGone(DataError):
    """No scheduler, or no worker that may compute. What is done is kept: the same may be asked again later."""
