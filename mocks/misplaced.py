"""True places of nests, cups and tool targets, which differ from the cell file.

An entry that `[simulation] misplaced_mm` names is off by this vector. Any other entry is off by a draw of its
stated `u_mm` per axis. Without a stated `u_mm` it is not off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mocks.cell_file import CellFile

PLACE_STREAM = 41
Vector = NDArray[np.float64]


def offsets(cell: CellFile) -> dict[str, Vector]:
    """Return the error of each place that is off, (3,) mm, by name.

    Nests are in the world frame, targets in the flange frame.
    """
    rng = np.random.default_rng([cell.seed, PLACE_STREAM])
    drawn = {name: u_mm * rng.normal(size=3) for name, u_mm in cell.u_mm.items()}
    return drawn | {name: np.array(off, dtype=float) for name, off in cell.misplaced_mm.items()}


def true_nests(cell: CellFile) -> dict[str, tuple[float, ...]]:
    """Return the true positions of the nests in the world frame, mm."""
    off = offsets(cell)
    return {name: tuple(np.asarray(p, dtype=float) + off.get(name, 0.0)) for name, p in cell.nests.items()}
