"""What the terminal says while a campaign chooses its poses."""

from __future__ import annotations

from typing import Any, cast

import pytest

from acquisition import Event, Run
from service.printed.progress import RunProgress
from service.printed.terminal import Terminal

LOOK: dict[str, Any] = {
    "poses": 20,
    "wanted_mm": 0.05,
    "bound_mm": 0.0612,
    "deciding_mm": 0.0648,
    "verdict": "attributed",
    "poses_left": 5,
    "ended": "",
}


class Sayings:
    """A terminal that keeps what is said."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def say(self, text: str) -> None:
        self.said.append(text)


@pytest.mark.parametrize(
    ("changed", "parts"),
    [
        ({}, ["20 poses", "0.061 mm", "0.065 mm", "required: 0.05 mm", "attributed", "5 more"]),
        ({"poses_left": None}, ["0.061 mm"]),
        ({"bound_mm": None, "verdict": "", "poses": 10}, ["10 poses", "too few"]),
        ({"ended": "The time is up: 30 minutes were given."}, ["The time is up"]),
    ],
)
def test_every_look_says_what_is_reached(changed: dict[str, Any], parts: list[str]) -> None:
    terminal = Sayings()
    progress = RunProgress(cast("Run", None), cast("Terminal", terminal))
    progress(Event(1, 0.0, 0.0, "accuracy", LOOK | changed))
    (said,) = terminal.said
    assert all(part in said for part in parts)
    assert ("more to go" in said) == ("5 more" in parts)
