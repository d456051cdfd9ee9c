"""`truepose fleet diagnose` as a person and a timer call it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from fleet.diagnose import DiagnosisOrder, ProgressCounts, batch, call, in_files
from fleet.diagnose.batch import work_off
from fleet.store import FleetStore
from service import exit_codes
from service.cli import main
from service.results.fleet_diagnosed import FleetRunResult
from tests.drivers.nobody import nobody_listens
from tests.fleet.diagnose.sets import bad, good
from tests.service.test_openapi import unnamed


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """The work is done in this process, without Dask."""

    def done(sources: Any, order: DiagnosisOrder, *_: object, **__: object) -> ProgressCounts:
        outcome = work_off(sources, order)
        return ProgressCounts(
            len(sources), done=outcome.done, refused=outcome.refused, seconds=outcome.seconds
        )

    monkeypatch.setattr("service.results.fleet_diagnosed.diagnose_all", done)


def call_for(folder: Path, *words: str) -> tuple[int, dict[str, Any]]:
    out = folder / "out.json"
    code = main(
        [
            "fleet",
            "diagnose",
            "--store",
            f"sqlite:///{folder}/s.sqlite3",
            "--json",
            str(out),
            "--most",
            "1",
            *words,
        ]
    )
    return code, json.loads(out.read_text("utf-8")) if out.is_file() else {}


@pytest.mark.usefixtures("here")
def test_a_result_is_shown_again_without_being_computed_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good(tmp_path, "a")
    bad(tmp_path, "b")
    code, document = call_for(tmp_path, str(tmp_path))
    assert code == exit_codes.DONE
    assert (document["data_sets"], document["done"], document["had_a_result"]) == (2, 2, 0)
    assert document["verdicts"] == {"attributed": 1, "refused": 1}
    (refusal,) = document["refused"]
    assert refusal["name"].endswith("b.csv")
    shown = capsys.readouterr().out
    assert "Attributed" in shown
    assert refusal["what"] in shown
    code, again = call_for(tmp_path, str(tmp_path))
    assert (again["done"], again["had_a_result"], again["verdicts"]) == (0, 2, document["verdicts"])


@pytest.mark.usefixtures("here")
def test_what_has_changed_since_a_version_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    data = good(tmp_path, "a")
    old = "0.0.9+before"
    monkeypatch.setattr(batch, "this_program", lambda: old)
    with monkeypatch.context() as silent:  # the version before knew no effects
        silent.setattr(batch, "diagnose", None)
        work_off(in_files([data]), DiagnosisOrder(f"sqlite:///{tmp_path}/s.sqlite3", "x", 0, old))
    with FleetStore.open(f"sqlite:///{tmp_path}/s.sqlite3") as store:
        (before,) = store.work.results()
        job = DiagnosisOrder("", "", 1, old).job(in_files([data])[0])
        store.work.finish(job, "x", before.content, before.finished_at, 1.0)
    monkeypatch.undo()
    monkeypatch.setattr(
        "service.results.fleet_diagnosed.diagnose_all",
        lambda sources, order, *_, **__: ProgressCounts(1, done=work_off(sources, order).done),
    )
    code, document = call_for(tmp_path, str(data), "--changed-since", "0.0.9")
    assert code == exit_codes.DONE
    assert unnamed(FleetRunResult.model_validate(document)) == set()
    changes = document["changes"]
    assert (changes["since"], changes["compared"]) == ([old], 1)
    (change,) = changes["changed"]
    assert (change["new"], change["gone"]) == (["backlash:j4"], [])
    assert (change["was"]["verdict"], change["now"]["verdict"]) == ("unexplained", "attributed")
    assert change["ratio"] < 0.7
    shown = capsys.readouterr().out
    assert "unexplained -> attributed" in shown
    assert "+ backlash:j4" in shown
    code, _ = call_for(tmp_path, str(data), "--changed-since", "7.0")
    assert code == exit_codes.USAGE
    assert "'7.0' has no results in this store. Those it has are of 0.0.9+before" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ([], "holds no data set"),
        (["nowhere.csv"], "there is no such file"),
        (["--workers", "2", "--scheduler", "tcp://127.0.0.1:1"], "cannot be combined with --scheduler"),
        (["--scheduler", "tls://10.0.0.5:8786"], "workers elsewhere cannot write to"),
    ],
)
def test_what_cannot_be_meant_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], why: str
) -> None:
    assert call_for(tmp_path, *words)[0] == exit_codes.USAGE
    assert why in capsys.readouterr().err


def test_without_a_store_nothing_begins(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("TRUEPOSE_STORE", raising=False)
    assert main(["fleet", "diagnose", "a.csv"]) == exit_codes.USAGE
    assert "results are kept in a store" in capsys.readouterr().err


def test_a_scheduler_that_is_not_there_is_not_available(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fleet.diagnose.engine.CONNECT_S", 0.5)
    with nobody_listens() as port:
        code, _ = call_for(tmp_path, str(bad(tmp_path, "b")), "--scheduler", f"127.0.0.1:{port}")
    assert code == exit_codes.NOT_AVAILABLE
    assert "no scheduler answers" in capsys.readouterr().err


WITHOUT = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("dask", "distributed"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
from service.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_a_cell_pc_needs_no_dask_and_is_told_what_to_install(tmp_path: Path) -> None:
    store = f"sqlite:///{tmp_path}/s.sqlite3"
    command = [sys.executable, "-c", WITHOUT, "fleet", "diagnose", str(bad(tmp_path, "b")), "--store", store]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == exit_codes.USAGE
    assert 'pip install "truepose[fleet]"' in done.stderr
    assert "Traceback" not in done.stderr


def test_an_open_way_is_said_before_anything_goes_over_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fleet.diagnose.engine.CONNECT_S", 0.1)
    monkeypatch.setattr(call, "exposed", lambda _: True)
    told: list[str] = []
    order = DiagnosisOrder(f"sqlite:///{tmp_path}/s.sqlite3", "x")
    with nobody_listens() as port, pytest.raises(ValueError, match="no scheduler"):
        call.diagnose_all(
            in_files([bad(tmp_path, "b")]),
            order,
            told.append,
            lambda _: None,
            scheduler=f"tcp://127.0.0.1:{port}",
        )
    assert "whoever reaches the scheduler has programs run" in told[0]
