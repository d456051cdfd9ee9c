"""Silence that a watchdog waits for, in real seconds while the simulator is running.

It is measured in real time because it guards the link. On a real controller no other program delays the
watchdog. A busy machine can delay a simulator for seconds. Meanwhile requests wait in its sockets, and moves
finish that no one has ended. Silence is therefore counted in pieces, each between two turns of the event loop.
Due tasks run first, and lost turns count as one piece.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

PIECES = 20


async def silence(seconds: float, last_word: Callable[[], object]) -> None:
    """Come back when the last word of the client has been the same for so long, from now on."""
    heard, quiet = last_word(), 0
    while quiet < PIECES:
        await asyncio.sleep(seconds / PIECES)
        before, heard = heard, last_word()
        quiet = quiet + 1 if heard == before else 0
