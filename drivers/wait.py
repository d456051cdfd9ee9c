"""The time for which a question of a driver waits for its answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypedDict


class Waiting(TypedDict, total=False):
    """The wait for an answer.

    It has the name of its deadline, its length in s if it is unusual, and a function to call meanwhile.
    """

    deadline: str
    seconds: float | None
    meanwhile: Callable[[], None] | None
