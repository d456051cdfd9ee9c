"""Records, data sets and models of earlier programs: what is read means what it meant; older records are refused."""

from __future__ import annotations

import csv
import hashlib
import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import truepose
from acquisition import read_status
from acquisition.errors import RecordError
from acquisition.record import FILE, RecordStore, export, rescue
from acquisition.record.schema import LAST_TO_READ_OLDER, VERSION
from service.cli import main
from tests.acquisition.fakes import new_store

HERE = Path(__file__).parent
MODELS = sorted(HERE.glob("version*"))
RECORD = HERE / f"version{VERSION}"
UNSEALED = "UPDATE campaign SET unsealed_poses = 3"
"""As a program of version 4 carried over what one of version 3 had begun."""
AT_DEG = [[10.0, 20.0, -30.0, 40.0, 50.0, 60.0]]


def rebuilt(folder: Path, out: Path) -> Path:
    """The record as that version left it; returns its folder."""
    out.mkdir()
    with closing(sqlite3.connect(out / FILE)) as connection:
        connection.executescript((folder / "record.sql").read_text("utf-8"))
    return out


def test_the_record_gives_the_data_set_that_it_gave(tmp_path: Path) -> None:
    record = rebuilt(RECORD, tmp_path / "record")
    status = read_status(record)
    assert (status.state, status.simulated, status.done) == ("succeeded", True, 51)
    then, now = _rows(RECORD / "data.csv"), _rows(export(record, tmp_path / "now.csv"))
    kept = set(then[0]) - {"series"}  # which later programs name
    assert kept <= set(now[0])
    assert [{key: row[key] for key in kept} for row in now] == [
        {key: row[key] for key in kept} for row in then
    ]
    with closing(RecordStore.open(record)) as store:  # and may be written to
        assert store.database.query("PRAGMA integrity_check")[0][0] == "ok"


@pytest.mark.parametrize("journal", [False, True], ids=["closed", "with a journal"])
@pytest.mark.parametrize("change", ["PRAGMA user_version = 4", "PRAGMA user_version = 1", UNSEALED])
def test_a_record_of_an_older_version_is_refused_by_name_and_never_changed(
    change: str, journal: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, record = rebuilt(RECORD, tmp_path / "made"), tmp_path / "record"
    with closing(sqlite3.connect(made / FILE)) as connection:
        if journal:
            connection.execute("PRAGMA journal_mode = WAL")
        connection.executescript(f"DROP TRIGGER campaign_fixed; {change}; SELECT 1 FROM campaign;")
        connection.commit()
        shutil.copytree(made, record)  # with its journal, as a program leaves it that is killed
    before = _bytes(record)
    assert len(before) == 1 + journal
    says = rf"version {3 if change is UNSEALED else change[-1]}.*reads version {VERSION}.*"
    for opened in (RecordStore.open, lambda at: RecordStore.open(at, writer=False), read_status):
        with pytest.raises(RecordError, match=says) as refused:
            opened(record)
        assert LAST_TO_READ_OLDER in refused.value.what_to_do
    orders = (
        ["export", str(record), str(tmp_path / "out.csv")],
        ["resume", str(record)],
        ["status", str(record)],
    )
    for order in (*orders, ["rescue", str(record), str(tmp_path / "saved")]):
        assert main(["campaign", *order]) not in (0, 1), order
        assert LAST_TO_READ_OLDER in capsys.readouterr().err, order
    with pytest.raises(RecordError, match=says):
        rescue(record, tmp_path / "saved.csv")
    with pytest.raises(RecordError, match="there is a record already"):
        new_store(record)
    assert _bytes(record) == before


def _bytes(record: Path) -> dict[str, str]:
    """Hash of what holds readings; the index of a journal is made anew by whoever reads."""
    files = [record / f"{FILE}{ending}" for ending in ("", "-wal")]
    held = {file.name: file.read_bytes() for file in files if file.exists()}
    return {name: hashlib.sha256(data).hexdigest() for name, data in held.items() if data}


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("folder", MODELS, ids=lambda folder: folder.name)
def test_a_model_judges_its_data_as_it_did(folder: Path) -> None:
    said = json.loads((folder / "model.json").read_text("utf-8"))
    model = truepose.load(folder / "model.json")
    judged = truepose.validate(model, folder / "data.csv")
    assert judged.errors.loc["model", "rms"] == pytest.approx(said["held_out"]["error_mm"]["rms"], abs=1e-5)
    assert any(effect.label == "backlash:j4" for effect in model.saved.model.effects)
    moved = truepose.compensate(model, joints_deg=AT_DEG)
    assert moved.good.all()
    assert 0.01 < np.max(np.abs(moved.joints_deg - AT_DEG)) < 2.0
