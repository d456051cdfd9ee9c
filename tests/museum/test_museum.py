"""Records, data sets and models of every earlier version are read by today's program, and mean what they meant then."""

from __future__ import annotations

import csv
import json
import re
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import truepose
from acquisition import read_status
from acquisition.record import FILE, Store, export
from acquisition.record.schema import SCRIPTS

HERE = Path(__file__).parent
VERSIONS = sorted(HERE.glob("version*"), key=lambda folder: int(folder.name.removeprefix("version")))
AT_DEG = [[10.0, 20.0, -30.0, 40.0, 50.0, 60.0]]


def rebuilt(folder: Path, out: Path) -> Path:
    """The record as that version left it; returns its folder."""
    out.mkdir()
    with closing(sqlite3.connect(out / FILE)) as connection:
        connection.executescript((folder / "record.sql").read_text("utf-8"))
    return out


def test_every_version_is_here() -> None:
    """A new script of the record needs the record that the old ones left."""
    assert [int(folder.name.removeprefix("version")) for folder in VERSIONS] == list(
        range(1, len(SCRIPTS) + 1)
    )
    for number, folder in enumerate(VERSIONS, start=1):
        text = (folder / "record.sql").read_text("utf-8")
        assert re.findall(r"^PRAGMA user_version = (\d+);$", text, re.MULTILINE) == [str(number)]


@pytest.mark.parametrize("folder", VERSIONS, ids=lambda folder: folder.name)
def test_a_record_gives_the_data_set_that_it_gave(folder: Path, tmp_path: Path) -> None:
    record = rebuilt(folder, tmp_path / "record")
    status = read_status(record)
    assert (status.state, status.simulated, status.done) == ("succeeded", True, 51)
    then, now = _rows(folder / "data.csv"), _rows(export(record, tmp_path / "now.csv"))
    assert len(now) == len(then) == 51
    kept = set(then[0]) - {"series"}  # which later versions name
    assert kept <= set(now[0])
    for before, after in zip(then, now, strict=True):
        assert {key: before[key] for key in kept} == {key: after[key] for key in kept}
    with closing(Store.open(record)) as store:  # and may be written to
        assert store.database.query("PRAGMA user_version")[0][0] == len(SCRIPTS)
        assert store.database.query("PRAGMA integrity_check")[0][0] == "ok"


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("folder", VERSIONS, ids=lambda folder: folder.name)
def test_a_model_judges_its_data_as_it_did(folder: Path) -> None:
    said = json.loads((folder / "model.json").read_text("utf-8"))
    model = truepose.load(folder / "model.json")
    judged = truepose.validate(model, folder / "data.csv")
    assert judged.errors.loc["model", "rms"] == pytest.approx(said["held_out"]["error_mm"]["rms"], abs=1e-5)
    assert any(effect.label == "backlash:j4" for effect in model.saved.model.effects)
    moved = truepose.compensate(model, joints_deg=AT_DEG)
    assert moved.good.all()
    assert 0.01 < np.max(np.abs(moved.joints_deg - AT_DEG)) < 2.0
