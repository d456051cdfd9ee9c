"""The list of sabotage keeps up with the program: every change can still be made, and its tests are there."""

from __future__ import annotations

import pytest

from tests.sabotage.__main__ import CHANGES
from tests.sabotage.change import Change


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.breaks)
def test_the_change_can_be_made(change: Change) -> None:
    assert change.stale() == ""
    assert change.old != change.new
    assert change.tests
