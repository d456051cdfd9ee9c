"""Pause of garbage collection for objects that remain in use."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def left_alone() -> Iterator[None]:
    """Exclude existing objects from garbage collection within this block.

    A report creates hundreds of thousands of small objects in addition to the readings and the model of its diagnosis.
    Searching through all of them took a twelfth of its time.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
