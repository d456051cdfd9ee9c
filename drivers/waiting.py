"""The time for which a question of a driver waits for its answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypedDict


class Waiting(TypedDict, total=False):
    """The wait for an answer: the name of its deadline, s where it is not that of every question, what goes on then."""

    deadline: str
    seconds: float | None
    meanwhile: Callable[[], None] | None
