"""Test the OmniCore example: a campaign with the second channel, and one that it pauses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquisition import Event, ExecutionOutcome, Run, export, open_devices
from calib import identify, read_dataset
from calib.arm import forward, load_robot
from drivers import ProtocolError, RehearsalOperator, WrongMode
from mocks.cell import CellThread
from mocks.cell_file import read_cell as read_mock_cell
from mocks.shared.clock import SteppedClock
from tests.drivers.waiting import until
from tests.end_to_end.simulated import ROOT, SteppedCampaignClock
from tests.end_to_end.test_examples import faster, run_simulated


def test_the_robot_file_is_the_published_chain() -> None:
    """ros-industrial/abb, crb15000_5_95_macro.xacro: the flange at zero, and turned by axis 5."""
    robot = load_robot("abb-crb15000-5-0.95.toml", ROOT / "examples" / "gofa_omnicore")
    zero, bent = forward(robot, np.radians([[0.0] * 6, [0.0, 0.0, 0.0, 0.0, 90.0, 0.0]]))
    assert zero[:3, 3] == pytest.approx([470 + 101, 0, 265 + 444 + 110 + 80], abs=1e-6)
    assert bent[:3, 3] == pytest.approx([470 + 80, 0, 265 + 444 + 110 - 101], abs=1e-6)


def test_it_runs_on_its_simulated_cell(tmp_path: Path) -> None:
    cell, campaign = faster("gofa_omnicore", "campaign", warm_up_s=0.0)
    with run_simulated(tmp_path, cell, campaign) as run:
        status = run.status()
        dataset = read_dataset(export(tmp_path / "record", tmp_path / "data.csv"))
    assert (status.total, status.skipped) == (40 * 3 + 6, 0)
    assert 0.7 < identify(dataset).noise_scale < 1.6  # its masses are estimated, those of the simulator not


def paused_by(folder: Path, **told: object) -> ExecutionOutcome:
    """Run the campaign, and change only the second channel after the fifth reading."""
    cell, campaign = faster("gofa_omnicore", "campaign", warm_up_s=0.0)
    file = folder / "cell.toml"
    file.write_text(cell.source, encoding="utf-8")
    described, clock = read_mock_cell(file), SteppedClock()
    with CellThread(described, devices=described.devices, clock=clock) as simulated:
        devices = open_devices(
            cell,
            operator=RehearsalOperator(),
            robot_url=simulated.url("abb"),
            instrument_url=simulated.url("faro"),
        )
        assert simulated.cell is not None
        asked, readings = simulated.cell.rws.asked, []

        def tell(event: Event) -> None:
            if event.kind == "reading":
                readings.append(event)
                if len(readings) == 5:
                    simulated.do("rws", **told)
                    before = len(asked)
                    until(lambda: len(asked) > before + 8)  # it was seen

        with Run.create(folder / "record", cell, campaign, simulated=True) as run:
            outcome = run.execute(devices, SteppedCampaignClock(clock), on_event=tell)
            assert outcome.state.value == "paused"
            assert run.status().done < 15  # of 126
    return outcome


def test_a_mode_change_that_only_the_second_channel_sees_pauses_the_run(tmp_path: Path) -> None:
    error = paused_by(tmp_path, mode="MANF").error
    assert isinstance(error, WrongMode)
    assert error.device == "abb"


def test_joints_that_differ_pause_the_run(tmp_path: Path) -> None:
    error = paused_by(tmp_path, off_deg=0.5).error
    assert isinstance(error, ProtocolError)
    assert error.device == "abb-rws"
    assert "apart" in error.message
