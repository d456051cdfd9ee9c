"""`kill -9` at random moments of a campaign on a simulated cell.

Nothing acknowledged is lost, and nothing is stored twice. The children acknowledge a reading by a line on their
standard output, written after the reading is durable.
`TRUEPOSE_KILLS` sets how often (8; 20 in `make long`); `python -m tests.benchmarks.campaign` does it 200 times.
"""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest

from acquisition.record.export import export
from calib.data.read import read_dataset
from tests.end_to_end.killing import kill_and_resume
from tests.end_to_end.simulated import campaign_file, cell_file

BY_HAND = 3
KILLS = int(os.environ.get("TRUEPOSE_KILLS", "8"))


@pytest.mark.timeout(600 + 6 * KILLS)
@pytest.mark.parametrize("driver", ["abb", "manual"])
def test_kill_at_random_moments(tmp_path: Path, driver: str) -> None:
    kills = KILLS if driver == "abb" else min(KILLS, BY_HAND)
    poses = (
        12 if driver == "abb" else 4
    ) + 2 * kills  # some are left for the last child, which is not killed
    cell = cell_file(tmp_path, time_scale=400.0 if driver == "abb" else 2000.0)
    if driver == "manual":  # it dies while a person is asked, drives or types
        given = cell.read_text("utf-8")
        cell.write_text(given.replace('driver = "abb"', 'driver = "manual"\nwithin_deg = 0.5'), "utf-8")
    campaign_file(tmp_path, calibration=poses, validation=2, warm_up_s=0.0, samples=20)
    tally = kill_and_resume(tmp_path, kills, 8, random.Random(6))
    assert tally.ending.startswith("succeeded"), tally.ending
    assert tally.killed == kills, "the campaign was over before every kill: make it longer"
    assert (tally.lost, tally.twice, tally.unknown, tally.left) == (0, 0, 0, 0)
    assert tally.sound
    assert tally.good <= tally.shots
    dataset = read_dataset(export(tmp_path / "record", tmp_path / "data.csv"))
    assert len(dataset) == len(set(dataset.reading_id)) >= 3 * (poses + 2)
