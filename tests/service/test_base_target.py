"""A displaced base ball, from the file to the report.

Its picture must not ask how far the ball moves the tool.
"""

from __future__ import annotations

import json
from pathlib import Path

from calib.saved.model_file import load_model
from service.cli import main
from tests.calib.cells import NOISE, Cell


def test_a_base_ball_out_of_place_is_drawn_and_kept(tmp_path: Path) -> None:
    cell = Cell(5)
    declared = {name: place.tolist() for name, place in cell.base_targets.items()}
    cell.base_targets["B2"] = cell.base_targets["B2"] + [0.9, -0.6, 0.75]
    cell.measure("l", 150, noise=NOISE)
    data = cell.dataset(tmp_path, base_targets=declared).path
    files = {name: tmp_path / name for name in ("r.html", "r.json", "m.json")}
    options = zip(("--report", "--json", "--model"), map(str, files.values()), strict=True)
    assert main(["diagnose", str(data), *(word for pair in options for word in pair)]) == 0
    document = json.loads(files["r.json"].read_text("utf-8"))
    assert [effect["label"] for effect in document["effects"]] == ["base_target_shift:B2"]
    assert "Check the seat of base target B2" in files["r.html"].read_text("utf-8")
    assert "base_target_shift:B2" in [effect.label for effect in load_model(files["m.json"]).model.effects]
