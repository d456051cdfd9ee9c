"""The joints of a UR arm as they are read back while it moves, over a separate connection.

The connection uses RTDE. A state is doubted if the speeds of the joints do not lead to it from the one before. The
reason is a damaged number, or states that were lost between the two. Not tried on a controller yet.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.interfaces import Sample
from drivers.ur.rtde import Rtde
from drivers.ur.state import StateConfirmer


@contextmanager
def joint_stream(rtde: Rtde) -> Iterator[Iterator[Sample]]:
    """Stream every state from now on until the block ends, which closes the connection.

    Raises
    ------
    LinkError
        The connection failed.
    """
    rtde.open()
    try:
        with rtde.watch("stream") as witness:
            yield _samples(witness)
    finally:
        rtde.close()


def _samples(witness: StateConfirmer) -> Iterator[Sample]:
    for state, led in witness.every():
        joints = tuple(math.degrees(q) for q in state.actual_rad)
        yield Sample(state.t_s, joints, doubt="" if led else "its speeds do not lead there")
