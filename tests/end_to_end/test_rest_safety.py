"""The service at a cell that is not its child process.

Stop during a move, a silent holder, `kill -9`, restart.
"""

from __future__ import annotations

import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.drivers.nobody import nobody_listens
from tests.drivers.waiting import until
from tests.end_to_end.simulated import SimulatedCell, campaign_file, cell_file, simulated_cell
from tests.service.test_http_support import Served, problem, served


def at_addresses(file: Path, robot: str, tracker: str) -> str:
    """The text of the cell file with robot and tracker at these addresses."""
    text = file.read_text("utf-8").replace("tcp://192.168.125.1:5000", robot)
    return text.replace("tcp://127.0.0.1:5701", tracker)


@contextmanager
def at_a_cell(
    folder: Path, time_scale: float, speed_deg_s: float = 20.0
) -> Iterator[tuple[SimulatedCell, Path]]:
    """Start separate simulators, and write a cell file with their addresses.

    They then seem to be real devices.
    """
    file = cell_file(folder, time_scale=time_scale)
    text = file.read_text("utf-8")
    assert "speed_deg_s = 20.0" in text
    file.write_text(text.replace("speed_deg_s = 20.0", f"speed_deg_s = {speed_deg_s}"), "utf-8")
    with simulated_cell(file) as simulated:
        real = folder / "real.toml"
        real.write_text(at_addresses(file, simulated.url("abb"), simulated.url("faro")), "utf-8")
        yield simulated, real


def order(folder: Path, **changes: object) -> dict[str, Any]:
    """The body that starts a run."""
    file = campaign_file(folder, warm_up_s=0.0, settle_s=0.0, samples=1, reference_every=0, **changes)
    return {"campaign": tomllib.loads(file.read_text("utf-8")), "dry_run": False}


def start(service: Served, body: dict[str, Any]) -> str:
    answer = service.client.post("/runs", json=body)
    assert answer.status_code == 202, answer.text
    return answer.json()["id"]


def test_stop_in_mid_move(tmp_path: Path) -> None:
    """A move takes most of a minute at real speed and 1 deg/s."""
    with (
        at_a_cell(tmp_path, 1.0, speed_deg_s=1.0) as (simulated, cell),
        served(tmp_path / "record", "--cell", str(cell)) as service,
    ):
        service.lease()
        run = start(service, order(tmp_path))
        until(lambda: simulated.do("state")["moving"])
        assert service.client.delete("/cell/lease").status_code == 204  # pauses after the reading in hand
        assert simulated.do("state")["moving"]
        stopped = service.client.post(f"/runs/{run}/stop")
        still = simulated.do("state")
        assert not still["moving"]
        assert stopped.status_code == 202
        assert stopped.json()["problems"] == []
        assert service.until(f"/runs/{run}", "stopped")["state_code"] == 7
        assert simulated.do("state")["joints_deg"] == still["joints_deg"]
        problem(service.client.post(f"/runs/{run}/resume"), 409)  # nobody holds the lease


def test_a_holder_who_falls_silent(tmp_path: Path) -> None:
    with (
        at_a_cell(tmp_path, 20.0) as (simulated, cell),
        served(tmp_path / "record", "--cell", str(cell)) as service,
    ):
        service.lease()
        run = start(service, order(tmp_path))
        until(lambda: simulated.do("state")["moving"])
        began = time.monotonic()
        service.lease(seconds=1.0)  # the last sign of life
        shown = service.until(f"/runs/{run}", "paused")
        assert time.monotonic() - began > 1.0
        assert shown["reason"] == "anna was not heard of for 1 s."
        rests = simulated.do("state")
        assert not rests["moving"]
        assert shown["done"] < shown["total"]
        assert service.client.get("/cell").json()["lease"] is None
        problem(service.client.post(f"/runs/{run}/resume"), 409)
        service.lease("bert")
        assert simulated.do("state")["joints_deg"] == rests["joints_deg"]
        assert service.client.post(f"/runs/{run}/resume").status_code == 202
        until(lambda: simulated.do("state")["moving"])
        assert service.client.post(f"/runs/{run}/stop").status_code == 202  # needs no lease


def test_killed_in_mid_run_it_comes_back_paused_and_moves_only_when_resumed(tmp_path: Path) -> None:
    record = tmp_path / "record"
    body = order(tmp_path, calibration=6, validation=2)
    with at_a_cell(tmp_path, 40.0) as (simulated, cell):
        with served(record, "--cell", str(cell)) as service:
            service.lease()
            key = {"Idempotency-Key": "only-once"}
            run = service.client.post("/runs", json=body, headers=key).json()["id"]
            until(lambda: service.client.get(f"/runs/{run}").json()["done"] >= 3)
            service.process.kill()
            service.process.wait()
        until(lambda: not simulated.do("state")["moving"])  # the controller ends the move it was given
        before = simulated.do("state")
        with served(record, "--cell", str(cell)) as service:
            (listed,) = service.client.get("/runs").json()["runs"]
            assert (listed["id"], listed["state"]) == (run, "paused")
            assert listed["done"] >= 3
            assert service.client.get("/cell").json()["run_id"] is None
            again = service.client.post("/runs", json=body, headers=key)  # the client tries again
            assert (again.status_code, again.json()["id"]) == (202, run)
            problem(service.client.post(f"/runs/{run}/resume"), 409)  # and has no lease any more
            service.client.get(f"/runs/{run}", params={"wait": 1, "after": listed["version"]})
            now = simulated.do("state")
            assert now["joints_deg"] == before["joints_deg"]
            assert now["readings"] == before["readings"]
            service.lease()
            resumed = [
                service.client.post(f"/runs/{run}/resume", headers={"Idempotency-Key": "go-on"})
                for _ in range(2)
            ]
            assert [answer.status_code for answer in resumed] == [202, 202]
            done = service.until(f"/runs/{run}", "succeeded", "failed", "paused")
            assert (done["state"], done["done"]) == ("succeeded", done["total"]), done
            problem(service.client.post(f"/runs/{run}/resume"), 409)


def test_pause_and_resume(tmp_path: Path) -> None:
    with (
        at_a_cell(tmp_path, 50.0) as (simulated, cell),
        served(tmp_path / "record", "--cell", str(cell)) as service,
    ):
        service.lease()
        run = start(service, order(tmp_path, calibration=6, validation=2))
        service.client.post(f"/runs/{run}/pause")  # at once, when it has hardly begun
        assert service.until(f"/runs/{run}", "paused")["done"] == 0
        assert service.client.post(f"/runs/{run}/resume").status_code == 202
        until(lambda: service.client.get(f"/runs/{run}").json()["done"] >= 1)
        assert service.client.post(f"/runs/{run}/pause").status_code == 202
        paused = service.until(f"/runs/{run}", "paused")
        assert paused["reason"] == "Paused on request."
        before = simulated.do("state")["readings"]
        assert service.client.get("/cell").json()["run_id"] is None
        assert service.client.post(f"/runs/{run}/resume").status_code == 202  # at once: nobody is busy
        assert service.until(f"/runs/{run}", "succeeded")["done"] == 24
        assert (
            simulated.do("state")["readings"] == before + (24 - paused["done"]) + 3
        )  # nests again, nothing twice


def test_devices_that_are_not_there_and_a_resume_at_another_cell(tmp_path: Path) -> None:
    cell = tmp_path / "real.toml"
    with nobody_listens() as robot, nobody_listens() as tracker:
        urls = f"tcp://127.0.0.1:{robot}", f"tcp://127.0.0.1:{tracker}"
        cell.write_text(at_addresses(cell_file(tmp_path, time_scale=50.0), *urls), "utf-8")
        with served(tmp_path / "record", "--cell", str(cell)) as service:
            service.lease()
            run = start(service, order(tmp_path))
            paused = service.until(f"/runs/{run}", "paused")
            assert 1000 <= paused["error"]["code"] < 2000
            assert "start the program that listens there" in paused["reason"]
    cell.write_text(cell.read_text("utf-8").replace("table_z_mm = 20.0", "table_z_mm = 30.0"), "utf-8")
    with served(tmp_path / "record", "--cell", str(cell)) as service:
        service.lease()
        assert problem(service.client.post(f"/runs/{run}/resume"), 409)["code"] == 8109
