"""Timeout of a call on busy machines: the start of a worker takes seconds of processor time."""

from __future__ import annotations

import pytest

from tests.drivers.waiting import PATIENCE_S


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A call waits for a worker as long as tests wait for what surely comes."""
    monkeypatch.setattr("fleet.diagnose.run.PATIENCE_S", PATIENCE_S)
