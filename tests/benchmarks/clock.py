"""Time of a call: the least processor time of some tries, s.

A busy machine disturbs this measure least.
"""

from __future__ import annotations

import time
from collections.abc import Callable


def seconds(
    call: Callable[[], object], tries: int = 5, clock: Callable[[], float] = time.process_time
) -> float:
    """Least time of `call` by a clock, that of the processor where no other is given."""
    least = float("inf")
    for _ in range(tries):
        begin = clock()
        call()
        least = min(least, clock() - begin)
    return least


def line(name: str, value: str, wanted: str, reached: bool) -> None:
    """One row of the table."""
    print(f"{name:<64} {value:>12} {wanted:>10}  {'ok' if reached else 'MISSED'}", flush=True)


def at_most(name: str, found: int, total: int, share: float) -> bool:
    """A count that may be a share of all at most."""
    reached = found <= share * total
    line(f"{name}, of {total}", str(found), f"<= {share:.1%}", reached)
    return reached


def at_least(name: str, found: int, total: int, share: float) -> bool:
    """A count that must be a share of all at least."""
    reached = found >= share * total
    line(f"{name}, of {total}", str(found), f">= {share:.0%}", reached)
    return reached
