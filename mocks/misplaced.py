"""Where the nests, cups and tool targets of a cell really are: beside the cell file, by what it says it knows of them.

Each is off by `[simulation] misplaced_mm` where it is named there, else by a draw of its stated `u_mm` per axis, else
not at all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mocks.cell_file import CellFile

PLACE_STREAM = 41
Vector = NDArray[np.float64]


def offsets(cell: CellFile) -> dict[str, Vector]:
    """How far everything that is off is off, (3,) mm: nests in the world, targets in the flange frame."""
    rng = np.random.default_rng([cell.seed, PLACE_STREAM])
    drawn = {name: u_mm * rng.normal(size=3) for name, u_mm in cell.u_mm.items()}
    return drawn | {name: np.array(off, dtype=float) for name, off in cell.misplaced_mm.items()}


def true_nests(cell: CellFile) -> dict[str, tuple[float, ...]]:
    """Where the nests really are in the world, mm."""
    off = offsets(cell)
    return {name: tuple(np.asarray(p, dtype=float) + off.get(name, 0.0)) for name, p in cell.nests.items()}
