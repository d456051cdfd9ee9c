"""The silence that a watchdog waits for: on the wall, for it guards the link, and only while a simulator has its turn.

No other program keeps a controller from its turn; a simulator is kept from it for seconds where the machine is busy.
Meanwhile words wait in its sockets, and moves are over that nobody has ended. So silence is counted in pieces, each
between two turns of the loop: what is due comes first, and turns that were lost count for one piece.
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
