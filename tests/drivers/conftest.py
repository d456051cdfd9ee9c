"""A cell with the simulated devices of a test module: its `ROBOT` and its `DEVICES`."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from mocks.cell import CellThread
from mocks.cell_file import CellFile


def _cell(request: pytest.FixtureRequest, time_scale: float) -> CellThread:
    file = CellFile(robot=request.module.ROBOT, time_scale=time_scale, effects=("none",))
    return CellThread(file, devices=request.module.DEVICES)


@pytest.fixture
def fast(request: pytest.FixtureRequest) -> Iterator[CellThread]:
    with _cell(request, 5000.0) as cell:
        yield cell


@pytest.fixture
def slow(request: pytest.FixtureRequest) -> Iterator[CellThread]:
    """Moves take seconds, for what happens during one."""
    with _cell(request, 1.0) as cell:
        yield cell
