"""The share that a worker is given at a time, and the progress of a call."""

from __future__ import annotations

import pytest

from fleet.diagnose.progress import ProgressCounts
from fleet.diagnose.run import AHEAD, BATCH_S, size_of


@pytest.mark.parametrize("each", [1e-9, 0.01, 1.0, 60.0])
def test_a_batch_takes_no_longer_than_agreed_and_leaves_work_for_all(each: float) -> None:
    for workers in (1, 4):
        for left in (1, 7, 1000, 100_000):
            size = size_of(left, workers, each)
            assert 1 <= size <= left
            assert size == 1 or size * each <= BATCH_S + each
            assert size == 1 or size * workers * AHEAD <= left


def test_the_first_batch_is_one_data_set() -> None:
    assert size_of(100_000, 4, None) == 1


def test_every_data_set_is_counted_once() -> None:
    tally = ProgressCounts(
        20, known=1, done=6, refused=2, found=3, twice=4, failed={"a": "why"}, seconds=3.0, elapsed=12.0
    )
    assert tally.left == 20 - (1 + 6 + 3 + 4 + 1)
    assert tally.seconds_each == pytest.approx(0.5)
    assert tally.seconds_left == pytest.approx(2.0 * tally.left)
    assert ProgressCounts(3).seconds_left is None
