"""`truepose calibrate`: from a nominal robot to a verified one, over the sockets of simulated devices.

These would catch: a motion that nobody confirmed, a calibration that cannot go on after a crash, one that writes over
files of others, and an accuracy that cannot be reached and is said to be only after an hour.
"""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer

from acquisition import Event, ExecutionOutcome, Run, State, read_cell, read_status
from acquisition.errors import StorageError
from acquisition.loop import LoopEnded, calibration_campaign, close_loop, loop, rehearsal
from acquisition.record import FILE
from drivers.errors import AcquisitionError
from service import wording
from service.cli import main
from service.commands.cell import calibrate
from service.commands.cell.calibrate import created_or_continued
from service.printed.terminal import Terminal
from service.results.cell import loop_results
from tests.drivers.waiting import PATIENCE_S, until
from tests.end_to_end.simulated import ROOT, stepped_cell, truepose
from tests.service.test_http_support import Served, served

SCALE = 500.0


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cell")
    rehearsal.write_files(folder, 3, "backlash:j4", SCALE, calibration=34, validation=8)
    return folder / "cell.toml"


def test_the_plan_alone_says_poses_minutes_and_accuracy(cell: Path, tmp_path: Path) -> None:
    asked = ("calibrate", str(cell), "--accuracy", "0.06", "--plan-only", "--record", str(tmp_path / "out"))
    shown = truepose(*asked, "--json", "-")
    assert shown.returncode == 0, shown.stderr
    outlook = json.loads(shown.stdout)
    assert outlook["format"] == "truepose-outlook/1"
    assert 15 <= outlook["poses"] <= 30
    assert outlook["floor_mm"] < outlook["limit_mm"] <= 0.06
    parts = (outlook[f"{part}_minutes"] for part in ("warm_up", "measuring", "verification"))
    assert outlook["minutes"] == pytest.approx(sum(parts))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--accuracy", "0.02"), "cannot be reached"),
        (("--minutes", "3"), "minutes are too short"),
        (("--zone", "x=5000:6000"), "larger"),
        (("--zone", "x=1"), "--zone"),
        (("--zone", "x=300:500,x=200:300"), "twice"),
        (("--minutes", "inf"), "--minutes"),
        (("--zone", "x=5:1"), "lower limit first"),
        ((), "no person at this terminal"),  # a real cell, and standard input is no terminal
    ],
)
def test_what_cannot_begin_is_said_before_anything_is_written(
    cell: Path, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    refused = truepose("calibrate", str(cell), *options, "--record", str(tmp_path / "out"))
    assert refused.returncode != 0
    assert words in refused.stderr
    assert "Traceback" not in refused.stderr
    assert not (tmp_path / "out").exists()


def test_it_goes_on_after_the_program_was_killed(cell: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    command = [
        "calibrate",
        str(cell),
        "--simulate",
        "--accuracy",
        "0.06",
        "--poses",
        "4",
        "--record",
        str(folder),
    ]
    for record, readings in (("campaign1", 8), ("campaign2", 6)):
        killed = subprocess.Popen(
            [sys.executable, "-m", "service.cli", *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=ROOT,
        )
        until(lambda place=folder / record, least=readings: _done(place) >= least)
        beside = _descendants(killed.pid)
        assert beside  # it computes looks and simulates devices there
        killed.send_signal(signal.SIGKILL)
        killed.wait(PATIENCE_S)
        until(lambda pids=beside: not any(map(_runs, pids)))
    before = read_status(folder / "campaign1")
    last = truepose(*command, "--poses", "5", "--json", str(tmp_path / "result.json"))
    assert last.returncode == 0, last.stderr
    assert "4 new poses" in last.stderr  # of the verification that has begun
    assert read_status(folder / "campaign1").version == before.version  # what was finished is used as it is
    result: dict[str, Any] = json.loads((tmp_path / "result.json").read_text("utf-8"))
    assert result["accuracy"]["reached"]
    verified = result["verification"]
    assert verified["poses"] == 4
    assert verified["error_verified_mm"]["rms"] < 0.1 * verified["error_uncorrected_mm"]["rms"]
    words = wording.HOLDOUTS["as measured"]
    report = (folder / "report.html").read_text("utf-8")
    assert words not in report + last.stdout  # no reading of the data set was held out
    certificate = (folder / "certificate.xml").read_text("utf-8")
    assert "held out: as measured" not in certificate
    assert f"{verified['error_verified_mm']['rms']:.12g}" in certificate
    for name in ("model.json", "report.html", "certificate.xml", "targets.csv", "data.csv"):
        assert (folder / name).stat().st_size
    (folder / "certificate.xml").unlink()  # as if the program had been killed once more just before
    assert truepose(*command).returncode == 0
    assert (folder / "certificate.xml").stat().st_size
    again = truepose(*command)
    assert again.returncode != 0
    assert "finished calibration" in again.stderr
    other = truepose(*command[:-1], str(folder), "--accuracy", "0.07")
    assert other.returncode != 0


@pytest.mark.parametrize("writing", [False, True])  # the results, or still in the loop
@pytest.mark.parametrize(
    ("ended", "words", "code"),
    [
        (KeyboardInterrupt(), "nothing moves", 130),
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), "Make room on the disk", StorageError.exit_code),
        (StorageError("less than 50 MB free"), "Make room on the disk", StorageError.exit_code),
    ],
)
def test_what_ends_it_where_nothing_moves_says_how_to_go_on(
    cell: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    writing: bool,
    ended: BaseException,
    words: str,
    code: int,
) -> None:
    def ends(*_: Any, **__: Any) -> None:
        raise ended

    monkeypatch.setattr(calibrate, "examine", lambda *_, **__: SimpleNamespace(exit_code=0))
    monkeypatch.setattr(calibrate, "close_loop", (lambda *_, **__: None) if writing else ends)
    monkeypatch.setattr(loop_results, "write", ends)
    assert main(["calibrate", str(cell), "--simulate", "--record", str(tmp_path / "out")]) == code
    said = capsys.readouterr().err
    assert "same command again" in said
    assert words in said


def test_a_question_that_is_broken_off_is_a_no(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken_off(*_: Any, **__: Any) -> bool:
        raise typer.Abort

    monkeypatch.setattr(typer, "confirm", broken_off)
    assert calibrate.terminal_confirmation(Terminal())("moves") is False


def test_a_request_to_end_is_heard_also_in_a_diagnosis(
    cell: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(calibrate, "examine", lambda *_, **__: SimpleNamespace(exit_code=0))
    monkeypatch.setattr(calibrate, "close_loop", lambda *_, **__: signal.raise_signal(signal.SIGTERM))
    assert main(["calibrate", str(cell), "--simulate", "--record", str(tmp_path / "out")]) == 130
    assert "same command again" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGTERM) is before


def _descendants(pid: int) -> list[int]:
    threads = Path(f"/proc/{pid}/task").iterdir()
    children = [int(each) for task in threads for each in (task / "children").read_text("utf-8").split()]
    return [*children, *(each for child in children for each in _descendants(child))]


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_record_whose_making_was_cut_off_is_made_anew(cell: Path, tmp_path: Path) -> None:
    (tmp_path / "campaign2").mkdir()
    (tmp_path / "campaign2" / FILE).touch()
    the_cell = read_cell(cell)
    campaign, _ = calibration_campaign(the_cell, accuracy_mm=0.1)
    assert loop.targets_of_record(tmp_path / "campaign2") is None
    with created_or_continued(tmp_path / "campaign2", the_cell, campaign, True) as run:
        assert run.status().state == "ready"


def _done(record: Path) -> int:
    try:
        return read_status(record).done if (record / FILE).is_file() else 0
    except AcquisitionError:  # it is just being made
        return 0


@pytest.mark.parametrize("begun", [False, True])
@pytest.mark.parametrize("name", ["report.html", "data1.csv"])  # data1 is written where poses follow
def test_a_file_of_another_program_is_not_replaced(
    cell: Path, tmp_path: Path, name: str, begun: bool
) -> None:
    if begun:  # and interrupted since
        _begun(cell, tmp_path / "campaign1")
    (tmp_path / name).write_text("mine")
    refused = truepose("calibrate", str(cell), "--simulate", "--record", str(tmp_path))
    assert refused.returncode != 0
    assert f"{name}: is there already" in refused.stderr
    assert (tmp_path / name).read_text() == "mine"
    assert (tmp_path / "campaign1").exists() == begun


def test_a_verification_of_another_calibration_is_not_judged(cell: Path, tmp_path: Path) -> None:
    """Its targets were corrected with another model."""
    _begun(cell, tmp_path / "campaign2")
    refused = truepose("calibrate", str(cell), "--simulate", "--record", str(tmp_path))
    assert refused.returncode != 0
    assert "campaign2 of a calibration" in refused.stderr
    assert not (tmp_path / "campaign1").exists()


def _begun(cell: Path, record: Path) -> None:
    the_cell = read_cell(cell)
    campaign, _ = calibration_campaign(the_cell, accuracy_mm=0.1)
    created_or_continued(record, the_cell, campaign, True).close()


def _refusing(asked: list[str]) -> Callable[[str], bool]:
    def confirm(motion: str) -> bool:
        asked.append(motion)
        return False

    return confirm


def test_corrected_targets_are_driven_only_with_leave(cell: Path, tmp_path: Path) -> None:
    """A person who says no keeps all that was measured."""
    asked: list[str] = []
    the_cell, _ = rehearsal.write_files(tmp_path, 3, "backlash:j4", 1.0, calibration=34, validation=8)
    campaign, _ = calibration_campaign(the_cell, accuracy_mm=0.1)
    with stepped_cell(the_cell) as equipment, pytest.raises(LoopEnded):
        close_loop(replace(equipment, confirm=_refusing(asked)), campaign, tmp_path, poses=4)
    assert len(asked) == 1
    assert (tmp_path / "data.csv").is_file()
    assert not (tmp_path / "campaign2").exists()


def test_targets_corrected_for_an_earlier_time_are_not_driven_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pose that an interruption has made old is corrected again."""
    the_cell, _ = rehearsal.write_files(tmp_path, 3, "backlash:j4", 1.0, calibration=34, validation=8)
    campaign, _ = calibration_campaign(the_cell, accuracy_mm=0.1)
    monkeypatch.setattr(loop, "follows_conditions", lambda *_: True)

    def dies_at_the_second(record: Path, *asked: Any) -> Run:
        run = created_or_continued(record, *asked)
        if record.name == "campaign3":
            run.close()
            raise KeyboardInterrupt
        return run

    with stepped_cell(the_cell) as equipment, pytest.raises(KeyboardInterrupt):
        close_loop(replace(equipment, create=dies_at_the_second), campaign, tmp_path, poses=3)
    assert read_status(tmp_path / "campaign3").state == "ready"
    with stepped_cell(the_cell) as equipment:
        result = close_loop(replace(equipment, create=created_or_continued), campaign, tmp_path, poses=3)
    assert read_status(tmp_path / "campaign3").state == "stopped"
    assert "before an interruption" in read_status(tmp_path / "campaign3").reason
    assert len(result.targets.wanted) == result.verification.poses == 3
    assert not result.targets.refused
    assert {read_status(tmp_path / f"campaign{n}").state for n in (2, 4, 5)} == {"succeeded"}


def test_targets_corrected_before_a_pause_are_not_driven_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one program: a pause within a run, and a rest between a correction and its run."""
    the_cell, _ = rehearsal.write_files(tmp_path, 3, "backlash:j4", 1.0, calibration=34, validation=8)
    campaign, _ = calibration_campaign(the_cell, accuracy_mm=0.1)
    monkeypatch.setattr(loop, "follows_conditions", lambda *_: True)
    rests: list[str] = []

    def listen(run: Run) -> Callable[[Event], None]:
        def hear(event: Event) -> None:
            if event.kind == "reading" and run.folder.name == "campaign2" and "pause" not in rests:
                rests.append("pause")
                threading.Thread(target=run.pause, args=("anna",)).start()

        return hear

    def create(record: Path, *asked: Any) -> Run:
        if record.name == "campaign4":
            rests.append("before the run")
        return loop.new_run(record, *asked)

    def resumed(run: Run, outcome: ExecutionOutcome) -> bool:
        run.resume(by="anna")
        return True

    said: list[str] = []
    with stepped_cell(the_cell) as equipment:
        equipment = replace(
            equipment,
            listen=listen,
            create=create,
            resumed=resumed,
            rests=lambda: rests.count("before the run"),
        )
        result = close_loop(equipment, campaign, tmp_path, poses=2, say=said.append)
    states = [read_status(tmp_path / f"campaign{n}").state for n in range(2, 6)]
    assert states == ["stopped", "succeeded", "stopped", "succeeded"]
    assert said.count(loop.AGAIN) == 2
    assert result.verification.poses == 2
    assert read_status(tmp_path / "campaign4").done == 0


def test_a_verification_that_a_person_has_finished_early_is_driven_whole(tmp_path: Path) -> None:
    """A part of its poses proves nothing."""
    the_cell, _ = rehearsal.write_files(tmp_path, 3, "backlash:j4", 1.0, calibration=34, validation=8)
    campaign, _ = calibration_campaign(the_cell, accuracy_mm=0.1)

    heard: list[Event] = []

    def listen(run: Run) -> Callable[[Event], None]:
        def hear(event: Event) -> None:
            heard.extend([event] * (event.kind == "reading" and run.folder.name == "campaign2"))
            if len(heard) == 2 * len(the_cell.nests):
                threading.Thread(target=run.pause, args=("anna",)).start()

        return hear

    with stepped_cell(the_cell) as equipment, pytest.raises(LoopEnded):
        close_loop(replace(equipment, listen=listen), campaign, tmp_path, poses=2)
    with Run.open(tmp_path / "campaign2") as run:
        run.finish("anna", "It is enough.")
    assert 0 < read_status(tmp_path / "campaign2").done < 12
    with stepped_cell(the_cell) as equipment:
        result = close_loop(replace(equipment, create=created_or_continued), campaign, tmp_path, poses=2)
    assert read_status(tmp_path / "campaign3").done == 12
    assert len(result.verification.landings) == 12
    assert result.verification.verified.n == 6


def test_targets_of_a_program_that_cannot_be_reached_are_said(cell: Path, tmp_path: Path) -> None:
    names = ",".join(["target_id", *(f"j{k}_deg" for k in range(1, 7))])
    rows = ["1,0,45,0,0,45,0", "2,10,50,-10,20,40,10", "3,0,500,0,0,45,0"]
    (tmp_path / "program.csv").write_text("\n".join([names, *rows]) + "\n", "utf-8")
    shown = truepose("calibrate", str(cell), "--plan-only", "--program", str(tmp_path / "program.csv"))
    assert shown.returncode == 0, shown.stderr
    assert "1 target cannot be reached" in shown.stderr
    (tmp_path / "program.csv").write_text("\n".join([names, rows[2]]) + "\n", "utf-8")
    refused = truepose("calibrate", str(cell), "--plan-only", "--program", str(tmp_path / "program.csv"))
    assert refused.returncode != 0
    assert "no target that can be the zone" in refused.stderr


def test_over_http_it_rests_until_a_person_lets_corrected_targets_be_driven(
    cell: Path, tmp_path: Path
) -> None:
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        client = service.client
        asked = {"accuracy_mm": 0.1, "poses": 4}
        dry = client.post("/loops", json=asked)
        assert dry.status_code == 202, dry.text
        assert dry.json()["outlook"]["poses"] >= 15
        assert "minutes at the cell" in dry.json()["reason"]
        wrong = client.post("/loops", json={"accuracy_mm": 0.01})
        assert wrong.status_code in (400, 409, 422), wrong.text
        assert "cannot be reached" in wrong.text
        assert client.post("/loops", json={"minutes": 10.0, "campaign_id": "x"}).status_code == 422
        lease = {"Lease-Id": service.lease("anna")["lease_id"]}
        begun = client.post("/loops", json=asked | {"dry_run": False}, headers=lease)
        assert begun.status_code == 202, begun.text
        path = f"/loops/{begun.json()['id']}"
        paused = service.until(path, "paused", "failed", "succeeded")
        assert paused["state"] == "paused", paused
        assert "corrected targets" in paused["reason"]
        assert len(paused["runs"]) == 1
        first = client.get(f"/runs/{paused['runs'][0]}").json()
        assert first["accuracy"]["reached"]
        assert first["accuracy"]["history"]
        assert client.post(f"{path}/resume", headers=lease).status_code == 202
        done = service.until(path, "succeeded", "failed", "stopped")
    assert done["state"] == "succeeded", done
    assert done["result"]["accuracy"]["reached"]
    assert done["result"]["verification"]["ratio"] < 3.0


def test_a_loop_that_the_service_did_not_outlive_is_paused_and_ends_on_resuming(
    cell: Path, tmp_path: Path
) -> None:
    """It is cut off in every phase; nothing moves before somebody resumes it, and no reading is taken twice."""
    path, lease = "", {"Lease-Id": ""}

    def phase(service: Served, document: dict[str, Any]) -> str:
        if document["state"] == "paused":
            return "question" if "corrected targets" in document["reason"] else "paused"
        run = document["run"]
        if run is None:
            return "planning" if not document["runs"] else "computing"
        if run["done"] < 4:
            return "beginning"
        return "measuring" if run["id"].endswith("campaign1") else "verifying"

    for cut in ("planning", "measuring", "computing", "question", "verifying", "end"):
        with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
            client = service.client
            lease["Lease-Id"] = service.lease("anna")["lease_id"]
            if not path:
                asked = {"accuracy_mm": 0.1, "poses": 4, "dry_run": False}
                path = f"/loops/{client.post('/loops', json=asked, headers=lease).json()['id']}"
            else:
                shown = client.get(path).json()
                assert (shown["state"], shown["run"]) == ("paused", None), shown
                assert client.post(f"{path}/pause").status_code == 202
                assert all(not State(run["state"]).active for run in client.get("/runs").json()["runs"])
                assert client.post(f"{path}/resume", headers=lease).status_code == 202
            while (now := phase(service, document := client.get(path).json())) != cut:
                if document["state"] in ("succeeded", "failed", "stopped"):
                    break
                assert now != "paused", document
                if now == "question":
                    assert client.post(f"{path}/resume", headers=lease).status_code == 202
            if cut != "end":
                assert now == cut, document
                service.process.kill()
    assert document["state"] == "succeeded", document
    assert document["runs"] == [f"{document['id']}-campaign{number}" for number in (1, 2)]
    assert document["result"]["verification"]["poses"] == 4
    assert document["result"]["verification"]["ratio"] < 3.0
