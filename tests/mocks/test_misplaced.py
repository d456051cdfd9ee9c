"""Test the true positions of nests, cups and tool balls in the simulators.

These would catch: a cell whose truth is its own file, offsets that change with the seed's other draws, and a
ballbar, tracker or camera that never sees them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mocks.cell import Cell, make_world
from mocks.cell_file import CellFile, read_cell
from mocks.misplaced import offsets, true_nests
from mocks.world import ArmState

CUPS = {"B1": (350.0, 170.0, 60.0), "B2": (200.0, -90.0, 60.0), "B3": (500.0, -90.0, 60.0)}
TARGETS = {"T1": (0.0, 80.0, 100.0), "T2": (-75.0, -40.0, 100.0), "T3": (75.0, -40.0, 100.0)}
AS_FILED = CellFile(nests=CUPS, targets=TARGETS, effects=("none",))
STILL = ArmState((10.0, 20.0, 5.0, 0.0, 40.0, 0.0), (0.0,) * 6, (1,) * 6)


def test_a_cell_of_which_nothing_is_stated_is_as_its_file_says() -> None:
    assert offsets(AS_FILED) == {}
    assert true_nests(AS_FILED) == CUPS


def test_they_are_off_by_draws_of_what_is_stated() -> None:
    u_mm = dict.fromkeys((*CUPS, *TARGETS), 0.3)
    drawn = [offsets(replace(AS_FILED, seed=seed, u_mm=u_mm)) for seed in range(1, 101)]
    all_of_them = np.array([list(each.values()) for each in drawn])
    assert np.sqrt(np.mean(all_of_them**2)) == pytest.approx(0.3, rel=0.1)
    assert np.array_equal(list(offsets(replace(AS_FILED, seed=7, u_mm=u_mm)).values()), all_of_them[6])
    half = offsets(replace(AS_FILED, seed=7, u_mm=u_mm | {"B2": 0.15, "T1": 0.0}))
    assert half["B2"] == pytest.approx(0.5 * all_of_them[6][1])
    assert half["T1"] == pytest.approx(np.zeros(3))


def test_what_is_named_is_off_by_that_and_no_draw() -> None:
    cell = replace(AS_FILED, u_mm=dict.fromkeys(CUPS, 0.3), misplaced_mm={"B2": (0.3, 0.0, 0.0)})
    assert offsets(cell)["B2"] == pytest.approx([0.3, 0.0, 0.0])
    assert offsets(cell)["B1"] == pytest.approx(offsets(replace(cell, misplaced_mm={}))["B1"])


def test_every_instrument_looks_at_where_they_are() -> None:
    off = {"B2": (0.0, 0.0, 0.5), "T1": (0.0, 3.0, 0.0)}
    filed, off_cell = Cell(AS_FILED), Cell(replace(AS_FILED, misplaced_mm=off))
    for see in (
        lambda cell: cell.qc20w.device.balls["B2"],
        lambda cell: cell.tracker.true_world("B2"),
        lambda cell: cell.at960.true_world("B2"),
        lambda cell: cell.ctrack.device.frame("B2")[:3, 3],
    ):
        assert see(off_cell) - see(filed) == pytest.approx([0.0, 0.0, 0.5])
    apart = np.subtract(off_cell.world.true_point(STILL, "T1"), filed.world.true_point(STILL, "T1"))
    assert np.linalg.norm(apart) == pytest.approx(3.0)
    assert off_cell.world.nominal_point(STILL, "T1") == filed.world.nominal_point(STILL, "T1")


def test_the_file_is_read(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    file.write_text(
        """
format = "truepose-cell/1"
[world]
nests = { B1 = [350, 170, 60], B2 = [200, -90, 60], B3 = [500, -90, 60] }
nests_u_mm = { B3 = 0.1 }
u_mm = 0.3
[tool]
targets = { T1 = [0, 80, 100], T2 = [75, -40, 100] }
targets_u_mm = { T2 = 0.02 }
[simulation]
misplaced_mm = { T1 = [0.1, 0, 0] }
""",
        "utf-8",
    )
    cell = read_cell(file)
    assert cell.u_mm == {"B1": 0.3, "B2": 0.3, "B3": 0.1, "T1": 0.0, "T2": 0.02}
    assert cell.misplaced_mm == {"T1": [0.1, 0, 0]}
    assert make_world(cell).misplaced["T1"] == pytest.approx([0.1, 0.0, 0.0])
