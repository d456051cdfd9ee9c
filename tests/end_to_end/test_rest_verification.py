"""The proof of a model over HTTP and at the terminal, on the sockets of a simulated cell.

These would catch a motion without a lease or without a check, and a driven model of another robot. They would catch a
robot lent to two, and a proof that a crash loses or that repeats readings. They would also catch a pose that was
corrected for the air before a pause and is driven after it.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from acquisition import export, read_status
from acquisition.loop import rehearsal
from acquisition.loop.loop import AGAIN, measure
from acquisition.record import is_begun
from calib import read_dataset
from calib.diagnose import diagnose
from calib.saved import save_model
from calib.saved.model_checks import content_hash
from tests.drivers.waiting import PATIENCE_S, until
from tests.end_to_end.simulated import ROOT, stepped_cell, truepose
from tests.service.test_http_support import Served, problem, served

SCALE = 400.0


def calibrated(folder: Path, effect: str, long: float = 1.0) -> tuple[Path, dict[str, Any]]:
    """A cell with a hidden effect, and the model of its robot, measured on an earlier day."""
    sizes = {"calibration": 34, "validation": 8, "seconds_per_reading": 7.5 * long}
    cell, campaign = rehearsal.write_files(folder, 3, effect, SCALE, **sizes)
    with stepped_cell(cell) as equipment:
        record = measure(equipment, campaign, folder / "earlier").record
    found = diagnose(read_dataset(export(record, folder / "data.csv")))
    save_model(folder / "model.json", found.final, found)
    return folder / "cell.toml", json.loads((folder / "model.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def backlash(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    return calibrated(tmp_path_factory.mktemp("backlash"), "backlash:j4")


def order(model: dict[str, Any], poses: int = 4, **more: Any) -> dict[str, Any]:
    return {"model": model, "poses": poses, "dry_run": False, **more}


def begun(service: Served, body: dict[str, Any]) -> str:
    answer = service.client.post("/verifications", json=body)
    assert answer.status_code == 202, answer.text
    return f"/verifications/{answer.json()['id']}"


def done(service: Served, path: str) -> dict[str, Any]:
    shown = service.until(path, "succeeded", "failed", "stopped")
    assert shown["state"] == "succeeded", shown
    return shown


def driving(service: Served, path: str, campaign: str, readings: int = 1) -> None:
    """Wait until a campaign of the proof has some readings."""

    def there() -> bool:
        run = service.client.get(path).json()["run"] or {}
        return run.get("id", "").endswith(campaign) and run["done"] >= readings

    until(there)


def test_a_model_is_proved_with_before_and_after(
    backlash: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    cell, model = backlash
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        client = service.client
        dry = client.post("/verifications", json={"model": model, "poses": 4})
        assert (dry.status_code, dry.json()["dry_run"], dry.json()["runs"]) == (202, True, []), dry.text
        assert "27 readings" in dry.json()["reason"]  # 4 poses twice and the first, three targets each
        assert client.get("/runs").json()["runs"] == []
        assert problem(client.post("/verifications", json=order(model)), 409)["code"] == 8101
        assert client.get("/verifications").json()["verifications"][0]["id"] == dry.json()["id"]
        service.lease("anna")
        key = {"Idempotency-Key": "today"}
        first, again = (client.post("/verifications", json=order(model), headers=key) for _ in range(2))
        assert (first.status_code, again.json()["id"]) == (202, first.json()["id"]), first.text
        path = f"/verifications/{first.json()['id']}"
        other = {"Lease-Id": "that of another client"}
        assert problem(client.post(f"{path}/resume", headers=other), 409)
        busy = problem(client.post("/verifications", json=order(model)), 409)
        assert busy["verification_id"] == first.json()["id"]
        shown = done(service, path)
        assert client.get(f"/results/{first.json()['id']}").json()["kind"] == "verification"
        assert problem(client.post(f"{path}/resume"), 409)
        assert problem(client.post(f"{path}/pause"), 409)
        assert client.get("/loops").json()["loops"] == []
    proof = shown["result"]["verification"]
    assert shown["runs"] == [f"{first.json()['id']}-campaign{n}" for n in (1, 2)]
    assert proof["error_verified_mm"]["n"] == proof["error_uncorrected_mm"]["n"] == 12
    assert proof["error_verified_mm"]["rms"] < 0.05 * proof["error_uncorrected_mm"]["rms"]
    rows = [row for row in proof["landings"] if row["corrected"]]
    assert {row["pose"] for row in rows} == {1, 2, 3, 4}
    rms = (sum(row["off_mm"] ** 2 for row in rows) / len(rows)) ** 0.5
    assert rms == pytest.approx(proof["error_verified_mm"]["rms"])
    assert all(0.01 < row["u_mm"] < 0.5 and len(row["error_mm"]) == 3 for row in rows)


def test_a_proof_that_a_crash_cuts_off_goes_on_from_its_records(
    backlash: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    cell, model = backlash
    options = (tmp_path / "record", "--cell", str(cell), "--simulate")
    with served(*options) as service:
        service.lease("anna")
        path = begun(service, order(model))
        driving(service, path, "campaign2", 2)
        service.process.send_signal(signal.SIGKILL)
        service.process.wait(PATIENCE_S)
    with served(*options) as service:
        client = service.client
        paused = client.get(path).json()
        assert (paused["state"], paused["run_id"]) == ("paused", None)
        assert "Resume" in paused["reason"]
        assert problem(client.post(f"{path}/resume"), 409)["code"] == 8101
        before = [client.get(f"/runs/{run}").json() for run in paused["runs"]]
        assert [run["state"] for run in before] == ["succeeded", "paused"]
        service.lease("bert")
        assert client.post(f"{path}/resume").status_code == 202
        shown = done(service, path)
        assert shown["runs"] == paused["runs"]
        assert client.get(f"/runs/{shown['runs'][0]}").json()["version"] == before[0]["version"]
    assert shown["result"]["verification"]["poses"] == 4
    assert shown["result"]["verification"]["error_verified_mm"]["n"] == 12


def test_a_service_that_ends_pauses_a_proof_and_another_cell_does_not_resume_it(
    backlash: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    cell, model = backlash
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        service.lease("anna")
        path = begun(service, order(model))
        driving(service, path, "campaign2")
        service.process.terminate()
        assert service.process.wait(PATIENCE_S) == 0
    other = tmp_path / "cell.toml"
    other.write_text(cell.read_text("utf-8") + "\n# moved\n", "utf-8")
    with served(tmp_path / "record", "--cell", str(other), "--simulate") as service:
        assert service.client.get(path).json()["state"] == "paused"
        service.lease("anna")
        assert problem(service.client.post(f"{path}/resume"), 409)["code"] == 8109
        assert service.client.post(f"{path}/stop").status_code == 202
        assert service.client.get(path).json()["state"] == "stopped"
        assert problem(service.client.post(f"{path}/resume"), 409)


def test_what_a_pause_has_caught_is_corrected_again_where_the_model_follows_the_air(tmp_path: Path) -> None:
    cell, model = calibrated(tmp_path, "thermal_growth", long=4.0)
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        client = service.client
        service.lease("anna")
        path = begun(service, order(model, poses=3))
        driving(service, path, "campaign2")
        assert client.post(f"{path}/pause").status_code == 202
        paused = service.until(path, "paused", "succeeded", "failed")
        assert paused["state"] == "paused", paused
        old = paused["run_id"]
        assert client.post(f"{path}/resume").status_code == 202
        shown = done(service, path)
        caught = client.get(f"/runs/{old}").json()
        assert caught["state"] == "stopped"
        assert "corrected" in caught["reason"]
        assert AGAIN in shown["steps"]
        assert len(shown["runs"]) == 5  # the first, three poses, and the one that was caught
    proof = shown["result"]["verification"]
    assert (proof["poses"], proof["error_verified_mm"]["n"], proof["refused"]) == (3, 9, [])
    assert proof["error_verified_mm"]["rms"] < 0.3 * proof["error_uncorrected_mm"]["rms"]


def test_a_model_of_another_robot_is_refused_with_what_to_do(
    backlash: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    cell, model = backlash
    table = model["robot_table"] | {"name": "another"}
    other = {key: value for key, value in model.items() if key != "robot_sha256"}
    other |= {"robot": "another", "robot_table": table}
    other["content_sha256"] = content_hash(other)
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        refused = problem(service.client.post("/verifications", json={"model": other}), 422)
        assert "another" in refused["detail"]
        assert "robot of the cell" in refused["what_to_do"]
        changed = model | {"gravity_base": [0.0, 0.0, -9.0]}
        assert (
            "changed"
            in problem(service.client.post("/verifications", json={"model": changed}), 422)["detail"]
        )
        problem(service.client.post("/verifications", json={"model_id": "none"}), 404)
        problem(service.client.post("/verifications", json={"poses": 3}), 422)
        assert service.client.get("/verifications").json()["verifications"] == []


def test_at_the_terminal_a_proof_goes_on_after_an_interruption(
    backlash: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    cell, model = backlash
    file, out = cell.parent / "model.json", tmp_path / "out"
    command = ["verify", str(cell), str(file), "--poses", "3", "--record", str(out)]
    planned = truepose(*command, "--simulate", "--plan-only")
    assert planned.returncode == 0, planned.stderr
    assert "21 readings" in planned.stdout
    real = truepose(*command)
    assert real.returncode != 0
    assert "simulated robot" in real.stderr  # and nobody is at the terminal
    assert not out.exists()
    with subprocess.Popen([sys.executable, "-m", "service.cli", *command, "--simulate"], cwd=ROOT) as process:
        until(lambda: is_begun(out / "campaign2") and read_status(out / "campaign2").done > 1)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 130
    changed = {key: value for key, value in model.items() if key != "noise_scale"}
    changed["content_sha256"] = content_hash(changed)
    (tmp_path / "other.json").write_text(json.dumps(changed), "utf-8")
    other = truepose("verify", str(cell), str(tmp_path / "other.json"), *command[3:], "--simulate")
    assert "another model" in other.stderr
    first = read_status(out / "campaign1").version
    again = truepose(*command, "--simulate", "--json", "-")
    assert again.returncode == 0, again.stderr
    proof = json.loads(again.stdout)["verification"]
    assert (proof["poses"], len(proof["landings"])) == (3, 18)
    assert proof["error_verified_mm"]["rms"] < 0.2 * proof["error_uncorrected_mm"]["rms"]
    assert read_status(out / "campaign1").version == first
    assert "finished verification" in truepose(*command, "--simulate").stderr
