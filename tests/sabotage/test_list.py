"""Test that every seeded fault can still be made, and that its tests exist."""

from __future__ import annotations

import pytest

from tests.sabotage.__main__ import CHANGES
from tests.sabotage.change import Change


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.breaks)
def test_the_change_can_be_made(change: Change) -> None:
    assert change.stale() == ""
    assert change.old != change.new
    assert change.tests
