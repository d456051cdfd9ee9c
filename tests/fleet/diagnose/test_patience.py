"""A store that is away during work: waited for, reported once, abandoned in the end."""

from __future__ import annotations

import pytest

from fleet.diagnose.run import FIRST_S, MOST_S, STORE_S, StoreRetry
from fleet.errors import StoreGone

GONE = StoreGone("does not answer.", do="Ask again.", file="postgresql://db/plant")


def test_it_is_asked_less_and_less_often_and_given_up_after_an_hour() -> None:
    told: list[str] = []
    now = 0.0
    patience = StoreRetry(told.append, lambda: now)
    patience.answered()
    assert not patience.away
    pauses: list[float] = []

    def wait() -> None:
        nonlocal now
        while True:
            patience.refused(GONE)
            assert patience.away
            begin = now
            while not patience.worth_asking():
                now += 0.5
            pauses.append(now - begin)

    with pytest.raises(StoreGone):
        wait()
    assert pauses[:4] == [FIRST_S, 2 * FIRST_S, 4 * FIRST_S, 8 * FIRST_S]
    assert max(pauses) == MOST_S
    assert STORE_S < now <= STORE_S + 2 * MOST_S
    (said,) = told
    assert "postgresql://db/plant: does not answer" in said
    assert "Ctrl-C" in said


def test_one_that_comes_back_is_told_and_may_go_again() -> None:
    told: list[str] = []
    now = 0.0
    patience = StoreRetry(told.append, lambda: now)
    for _ in range(2):
        patience.refused(GONE)
        now += STORE_S / 2
        patience.refused(GONE)
        now += 60.0
        patience.answered()
        assert not patience.away
    assert [each.startswith("the store answers again, after 1860 s") for each in told] == [False, True] * 2
