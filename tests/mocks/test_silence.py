"""Test that the watchdog of a simulated controller triggers for a silent client only.

A busy machine must not trigger it.
"""

from __future__ import annotations

import asyncio

import pytest

from mocks.shared.silence import PIECES, silence


def test_whoever_is_kept_from_its_turn_does_not_take_it_for_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene() -> bool:
        loop = asyncio.get_running_loop()
        now = loop.time
        guard = asyncio.create_task(silence(0.1, lambda: 0))
        move = asyncio.create_task(asyncio.sleep(0.05))
        await asyncio.sleep(0)
        monkeypatch.setattr(loop, "time", lambda: now() + 0.3)  # the machine has done other things
        await move
        barked = guard.done()
        await guard
        return barked

    assert asyncio.run(scene()) is False


def test_silence_is_counted_from_the_last_word(monkeypatch: pytest.MonkeyPatch) -> None:
    naps: list[float] = []

    async def nap(seconds: float) -> None:
        naps.append(seconds)

    monkeypatch.setattr(asyncio, "sleep", nap)
    words = [2 * PIECES // 3, 3 * PIECES // 2]  # the naps in which the client speaks
    asyncio.run(silence(2.0, lambda: sum(len(naps) >= word for word in words)))
    assert len(naps) == words[-1] + PIECES
    assert sum(naps[words[-1] :]) == pytest.approx(2.0)
