"""Pose accuracy and repeatability of ISO 9283 in the report, where poses repeat."""

from __future__ import annotations

import html
from pathlib import Path

from calib.data import read_dataset
from calib.fit import base_model_of, place_nominal
from calib.validation import judge_repeats
from mocks.campaign import make_campaign, write_campaign
from service.cli import main
from service.report.sections.repeats import section_of
from tests.service.campaigns import write_data

TITLE = "Pose accuracy and repeatability (ISO 9283)"


def test_poses_that_repeat_are_in_the_report(tmp_path: Path) -> None:
    campaign = make_campaign(seed=4, n=60, n_validation=20, effects=[], size=6.0, reference_every=20)
    data = Path(write_campaign(campaign, tmp_path)["csv"])
    dataset = read_dataset(data)
    nominal, placed = place_nominal(dataset, base_model_of(dataset))
    poses = judge_repeats(dataset, nominal, placed).poses
    section = section_of(dataset, nominal, placed)
    assert section is not None
    worst = max(poses, key=lambda pose: pose.repeatability)
    row = section["rows"][0]
    assert row[0] == dataset.reading_id[worst.reading]
    assert row[3:7] == (
        worst.visits,
        worst.directions,
        f"{worst.accuracy:.3f}",
        f"{worst.repeatability:.3f}",
    )
    report = tmp_path / "r.html"
    assert main(["identify", str(data), "--report", str(report)]) == 0
    page = html.unescape(report.read_text("utf-8"))
    assert TITLE in page
    assert f'<td class="n">{worst.repeatability:.3f}</td>' in page  # needs no model
    assert "The standard asks for 30 visits" in page


def test_poses_that_never_repeat_are_no_section(tmp_path: Path) -> None:
    dataset = read_dataset(write_data(tmp_path, effects=(), n=60))
    nominal, placed = place_nominal(dataset, base_model_of(dataset))
    assert section_of(dataset, nominal, placed) is None
