"""True motions of the simulated arms of the rigs."""

from __future__ import annotations

from collections.abc import Sequence

from mocks.cell import CellThread

SCALE = 5000.0  # a 20 deg move at 20 deg/s takes 0.2 ms


def sent_elsewhere(
    cell: CellThread, goals: Sequence[Sequence[float]], within: float
) -> list[tuple[float, ...]]:
    """List the targets of moves that the simulated arm began but that are none of `goals`.

    Angles are model angles, deg.
    """
    assert cell.cell is not None
    return [
        sent
        for sent in cell.cell.arm.sent_to
        if not any(max(abs(a - b) for a, b in zip(sent, goal, strict=True)) <= within for goal in goals)
    ]
