"""Positions with a stated uncertainty, as terminal, JSON and report show them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from calib.fit.identify import identify
from calib.fit.offsets import offsets_of
from service.cli import main
from tests.benchmarks.nests import data_sets


def test_the_cup_out_of_place_is_in_text_json_and_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, sets = data_sets(4, tmp_path, cups_u_mm=0.05)
    dataset = sets["uncertain"]
    found = {offset.name: offset for offset in offsets_of(identify(dataset))}
    assert found["B3"].judged.doubted
    result, report = tmp_path / "r.json", tmp_path / "r.html"
    assert main(["identify", str(dataset.path), "--json", str(result), "--report", str(report)]) == 0
    text = re.sub(r"\s+", " ", capsys.readouterr().out)
    assert "Positions known to an uncertainty" in text
    assert "measure anew" in text
    document = json.loads(result.read_text("utf-8"))
    entries = {entry["name"]: entry for entry in document["offsets"]}
    assert list(entries) == ["T1", "T2", "T3", "B1", "B2", "B3"]
    assert entries["B3"]["doubted"]
    assert not entries["T1"]["doubted"]
    assert entries["B3"]["offset_mm"] == pytest.approx(found["B3"].offset_mm)
    assert entries["B3"]["std_mm"] == pytest.approx(found["B3"].std_mm)
    assert entries["B3"]["kind"] == "base target"
    assert document["warnings"][0] == found["B3"].in_words()
    page = report.read_text("utf-8")
    assert page.count("Positions known to an uncertainty</h2>") == 1
    assert "Base target B3 lies" in page
