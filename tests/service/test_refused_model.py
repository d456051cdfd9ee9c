"""Readings that a fit left out, and fits that did not converge.

Everything is reported, and only the model is refused.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from calib import Dataset, DiagnosisFit, IdentificationFit, read_dataset
from calib import identify as fitted_by
from calib.diagnose import diagnose as found_by
from calib.fit import left_out, silent
from calib.fit.ending import FitTermination
from mocks.campaign import make_campaign, write_campaign
from service import job, job_folder
from service.cli import main
from service.results.models import diagnosed, identified


@pytest.fixture(scope="module")
def spoilt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign in which 22 readings of 230 are 2 mm off."""
    folder = tmp_path_factory.mktemp("spoilt")
    campaign = make_campaign(seed=41, n=230, n_validation=10, effects=[], gross_rows=22)
    write_campaign(campaign, folder)
    return folder / "data.csv"


def test_every_reading_left_out_is_listed_with_its_pose_and_error(
    spoilt: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = json.loads((spoilt.parent / "truth.json").read_text("utf-8"))
    assert (
        main(
            [
                "identify",
                str(spoilt),
                "--json",
                str(tmp_path / "r.json"),
                "--report",
                str(tmp_path / "r.html"),
            ]
        )
        == 0
    )
    rows = json.loads((tmp_path / "r.json").read_text("utf-8"))["left_out"]
    assert {row["reading"] for row in rows} == set(truth["faulty_rows"])
    assert all(abs(row["error_mm"] - 2.0) < 0.3 and row["times_noise"] > 20.0 for row in rows)
    written = {
        int(line.split(",")[0]): line.split(",") for line in spoilt.read_text("utf-8").splitlines()[1:]
    }
    worst = rows[0]
    assert worst["joints_deg"] == pytest.approx(
        [float(cell) for cell in written[worst["reading"]][3:9]], abs=1e-3
    )
    assert worst["times_noise"] == max(row["times_noise"] for row in rows)
    text = capsys.readouterr().out
    assert "Readings left out (22)" in text
    assert "and 2 more" in text, "twenty of them are listed"
    report = (tmp_path / "r.html").read_text("utf-8")
    assert all(f"<code>{number}</code>" in report for number in truth["faulty_rows"])


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small campaign without a fault."""
    folder = tmp_path_factory.mktemp("plain")
    write_campaign(make_campaign(seed=40, n=60, n_validation=10, effects=[]), folder)
    return folder / "data.csv"


def test_nothing_is_listed_where_nothing_was_left_out(plain: Path) -> None:
    data = read_dataset(plain)
    assert left_out(data, fitted_by(data)) == ()


def unfinished(dataset: Dataset, **options: object) -> DiagnosisFit:
    result = found_by(dataset)
    return replace(result, final=replace(result.final, ending=FitTermination.ROUNDS))


def unfinished_fit(dataset: Dataset, **options: object) -> IdentificationFit:
    return replace(fitted_by(dataset, progress=silent), ending=FitTermination.ROUNDS)


def test_of_a_fit_that_did_not_converge_only_the_model_is_refused(
    plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(diagnosed, "diagnose", unfinished)
    monkeypatch.setattr(identified, "identify", unfinished_fit)
    for command, words in (("diagnose", "Complete."), ("identify", "Parameters")):
        out = tmp_path / command
        out.mkdir()
        files = [
            "--json",
            str(out / "r.json"),
            "--report",
            str(out / "r.html"),
            "--model",
            str(out / "m.json"),
        ]
        assert main([command, str(plain), *files]) == 2
        shown = capsys.readouterr()
        assert words in shown.out
        assert "did not converge: it is not saved as a model" in shown.err
        found = json.loads((out / "r.json").read_text("utf-8"))
        assert (found["converged"], found["ending"]) == (False, "round limit")
        assert (out / "r.html").is_file()
        assert not (out / "m.json").exists()


def test_a_job_of_the_service_keeps_what_it_found_without_a_model(
    plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(diagnosed, "diagnose", unfinished)
    monkeypatch.setattr(identified, "identify", unfinished_fit)
    for kind in ("diagnosis", "identification"):
        folder = tmp_path / kind
        folder.mkdir()
        (folder / job_folder.JOB).write_text(json.dumps({"kind": kind, "data": str(plain)}), encoding="utf-8")
        job.do(folder)
        kept = {path.name for path in folder.iterdir()} - {job_folder.STEP, job_folder.ARROWS}
        assert kept == {job_folder.JOB, job_folder.RESULT, job_folder.REPORT}
