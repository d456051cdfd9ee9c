"""Garbage is not sought among what stays."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def left_alone() -> Iterator[None]:
    """Within this block the garbage collector passes over the objects that exist already.

    A report makes hundreds of thousands of small objects beside the readings and the model of its diagnosis, and every
    search through all of them took a twelfth of its time.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
