"""`python -m tests.benchmarks.stop_cell CELL.toml`: simulated cell that reports its halts.

Its back door returns the time at which the arm was halted:

{"do": "halted"} -> {"ok": true, "at_s": 1234.5}     on the steady clock, which all programs of a computer share
"""

from __future__ import annotations

import asyncio
import sys
import time
from pathlib import Path

from mocks.__main__ import serve
from mocks.cell import Cell
from mocks.cell_file import read_cell


def main(file: Path) -> None:
    """Serve until the end is requested."""
    cell = Cell(read_cell(file), devices=("abb", "faro"))
    halt, halted = cell.arm.halt, [0.0]

    def noted() -> None:
        halted.append(time.monotonic())
        halt()

    cell.arm.halt = noted
    cell.backdoor.further = {**cell.backdoor.further, "halted": lambda _: {"at_s": halted[-1]}}
    asyncio.run(serve(cell, 0))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
