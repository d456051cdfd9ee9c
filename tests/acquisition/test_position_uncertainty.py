"""Uncertainty of a cell's positions, from the cell file to the data set.

These would catch: an uncertainty that is misread, lost or given to another name. They would also catch an unverified
cup exported as exact, and old records refused.
"""

from __future__ import annotations

import tomllib
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition import Run, export
from acquisition.cell.cell import MADE_MM, TAUGHT_MM
from acquisition.cell.world_frame import from_nests
from acquisition.errors import NestsDisagree
from acquisition.record import export_together
from calib import read_dataset
from calib.data import Header, assumed_in_words
from service.cli import main
from tests.acquisition.fakes import (
    BALLBAR,
    HEXAPOD,
    Bench,
    JumpingClock,
    SeatingOperator,
    a_campaign,
    a_cell,
    devices_of,
)

CUPS, BALLS = ("B1", "B2", "B3"), ("T1", "T2", "T3")


def recorded(folder: Path, seed: int = 3, **cell: Any) -> Path:
    """The record of a campaign on fakes."""
    bench = Bench(a_cell(**cell))
    campaign = a_campaign(
        seed=seed, **({"block": HEXAPOD} if bench.cell.instrument.declared.measures_lengths else {})
    )
    with closing(Run.create(folder, bench.cell, campaign, simulated=True)) as run:
        outcome = run.execute(devices_of(bench, SeatingOperator(bench)), JumpingClock())
    assert outcome.state.value == "succeeded"
    return folder


def exported(folder: Path, **cell: Any) -> Header:
    """The header of the data set of a campaign on fakes."""
    return read_dataset(export(recorded(folder / "record", **cell), folder / "out.csv")).header


def test_one_for_all_and_by_name(tmp_path: Path) -> None:
    stated = {"world__u_mm": 0.3, "world__nests_u_mm": {"B2": 0.02}, "tool__targets_u_mm": {"T3": 0.01}}
    cell = a_cell(**BALLBAR, **stated)
    assert cell.nests_u_mm == {"B1": 0.3, "B2": 0.02, "B3": 0.3}
    assert cell.tool.stated_mm == {"T3": 0.01}
    assert cell.unstated == ("T1", "T2")
    header = exported(tmp_path, **BALLBAR, **stated)
    assert header.base_targets_u_mm == cell.nests_u_mm
    assert header.tool_targets_u_mm == {"T1": MADE_MM, "T2": MADE_MM, "T3": 0.01}
    assert header.u_mm_assumed == ("T1", "T2")


def test_what_nobody_stated_is_never_exact_and_said(tmp_path: Path) -> None:
    header = exported(tmp_path, **BALLBAR)
    assert header.base_targets_u_mm == dict.fromkeys(CUPS, TAUGHT_MM)
    assert header.tool_targets_u_mm == dict.fromkeys(BALLS, MADE_MM)
    assert header.u_mm_assumed == (*CUPS, *BALLS)
    assert "B2 (1 mm), B3 (1 mm), T1 (0.2 mm)" in assumed_in_words(header)


def test_exact_only_where_somebody_says_so(tmp_path: Path) -> None:
    header = exported(tmp_path, **BALLBAR, world__u_mm=0, tool__u_mm=0.0)
    assert header.base_targets_u_mm == header.tool_targets_u_mm == {}
    assert header.u_mm_assumed == ()
    assert assumed_in_words(header) == ""


def test_points_free_the_tool_only_where_it_is_stated(tmp_path: Path) -> None:
    plain, stated = exported(tmp_path / "1"), exported(tmp_path / "2", tool__u_mm=0.05, world__u_mm=0.02)
    assert plain.tool_targets_u_mm == {}
    assert stated.tool_targets_u_mm == dict.fromkeys(BALLS, 0.05)
    assert plain.u_mm_assumed == stated.u_mm_assumed == ()
    assert stated.base_targets_u_mm == {}


def test_records_of_one_cell_go_together_though_it_was_stated_only_later(tmp_path: Path) -> None:
    first = recorded(tmp_path / "1", **BALLBAR)
    second = recorded(tmp_path / "2", seed=9, **BALLBAR, world__u_mm=0.1)
    header = read_dataset(export_together([first, second], tmp_path / "both.csv")).header
    assert header.base_targets_u_mm == dict.fromkeys(CUPS, TAUGHT_MM)
    table = tomllib.loads((tmp_path / "both.toml").read_text("utf-8"))
    assert table["u_mm_assumed"] == [*CUPS, *BALLS]


def test_nests_may_disagree_by_what_they_are_known_to() -> None:
    nests = {"N1": (0.0, 0.0, 0.0), "N2": (600.0, 0.0, 0.0), "N3": (0.0, 600.0, 0.0)}
    off = nests | {"N2": (604.0, 0.0, 0.0)}
    with pytest.raises(NestsDisagree, match=r"604\.00 mm"):
        from_nests(off, nests, dict.fromkeys(nests, 0.5))
    assert np.allclose(from_nests(off, nests, dict.fromkeys(nests, 1.0)).origin, 0.0)
    with pytest.raises(NestsDisagree):
        from_nests(off, nests, {"N3": 5.0})


def test_a_campaign_says_what_it_assumes_before_it_begins(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.commands.cell.campaign.execute", lambda *_, **__: None)  # no device is there
    campaign = tmp_path / "campaign.toml"
    campaign.write_text(a_campaign(block=HEXAPOD).source, "utf-8")
    for name, stated, said in (("1", {}, True), ("2", {"world__u_mm": 0.3, "tool__u_mm": 0.05}, False)):
        cell = tmp_path / f"cell{name}.toml"
        cell.write_text(a_cell(**BALLBAR, **stated).source, "utf-8")
        assert main(["campaign", "run", str(cell), str(campaign), "--record", str(tmp_path / name)]) == 0
        shown = capsys.readouterr().err
        assert (
            "does not state how well B1, B2, B3, T1, T2, T3 are known: 1 mm is assumed of a cup" in shown
        ) == said
