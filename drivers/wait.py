"""The time for which a question of a driver waits for its answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypedDict


class Waiting(TypedDict, total=False):
    """The wait for an answer: name of its deadline, length in s if it is unusual, and what is called meanwhile."""

    deadline: str
    seconds: float | None
    meanwhile: Callable[[], None] | None
