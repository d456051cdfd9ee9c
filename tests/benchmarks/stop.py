"""Benchmark of a stop in mid-motion under load: time to the answer and to the controller.

The load is 200 other requests under way, 1,100 connections that send nothing or half a header, and 200 streams of
events. Service, simulators and the 200 clients (`stop_load`) are separate programs; the simulator records the time
at which the arm was halted (`stop_cell`). The times of lease renewals and of run status requests are printed as
well.

Answers must arrive within 100 ms, and the command at the controller within 300 ms, in each of 20 tries: the worst
one counts. To show the delay of the machine itself, the simulators, another program that hardly computes, are asked
too.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.benchmarks.clock import line
from tests.benchmarks.stop_load import HELD
from tests.drivers.waiting import until
from tests.end_to_end.simulated import ROOT, SimulatedCell, campaign_file, cell_file
from tests.service.campaigns import write_data
from tests.service.test_http_support import Served, served

TRIES, ROWS = 20, 400
ANSWER_MS, ARRIVAL_MS = 100.0, 300.0
PATIENCE_S = 120.0
LEASE = {"holder": "anna", "seconds": 300.0}
BESIDE = "(the simulators, asked directly)"


def run(count: int = TRIES) -> bool:
    """Print the figures; True when all are reached."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with _cell(folder) as (simulated, cell), served(folder / "record", "--cell", str(cell)) as service:
            quiet = _try(simulated, service, _begin(service, folder), count)
            body = _begin(service, folder)
            data = write_data(folder, n=ROWS)
            with _load(service, body, data):
                busy = {"200 requests under way": _try(simulated, service, body, count)}
            for load, number in HELD.items():
                body = _begin(service, folder)
                with _load(service, body, data, load):
                    busy[f"{number} x {load}"] = _try(simulated, service, body, count)
    for what, times in quiet.items():
        line(f"{what}, nobody else asks: median", f"{statistics.median(times):.0f} ms", "", True)
    reached = True
    for load, figures in busy.items():
        for what, times in figures.items():
            wanted = ARRIVAL_MS if "controller" in what else ANSWER_MS
            good = what == BESIDE or max(times) < wanted
            reached &= good
            told = "" if what == BESIDE else f"< {wanted:g} ms"
            line(f"{what}, {load}: median / max", _figures(times), told, good)
    return reached


def _figures(times: list[float]) -> str:
    return f"{statistics.median(times):.0f} / {max(times):.0f} ms"


def _begin(service: Served, folder: Path) -> str:
    """A run that moves slowly."""
    file = campaign_file(folder, warm_up_s=0.0, settle_s=0.0, samples=1, reference_every=0)
    order = {"campaign": tomllib.loads(file.read_text("utf-8")), "dry_run": False}
    service.lease(seconds=300.0)
    begun: list[str] = []

    def begin() -> bool:  # what an earlier load has ordered may still be computed
        answer = service.client.post("/runs", json=order)
        begun.extend([answer.json()["id"]] if answer.status_code == 202 else [])
        return answer.status_code == 202

    until(begin, PATIENCE_S)
    return begun[0]


def _try(simulated: SimulatedCell, service: Served, run: str, count: int) -> dict[str, list[float]]:
    """Measure `count` stops in mid-motion, and the requests just before each, ms."""
    times: dict[str, list[float]] = {
        BESIDE: [],
        "lease renewed": [],
        "status": [],
        "stop answered": [],
        "stop at the controller": [],
    }
    for number in range(count):
        if number:
            until(lambda: service.client.post(f"/runs/{run}/resume").status_code == 202, PATIENCE_S)
        until(lambda: simulated.do("state")["moving"], PATIENCE_S)
        times[BESIDE].append(_ms(lambda: simulated.do("state")))
        times["lease renewed"].append(_ms(lambda: service.client.post("/cell/lease", json=LEASE)))
        times["status"].append(_ms(lambda: service.client.get(f"/runs/{run}")))
        assert simulated.do("state")["moving"]
        begin = time.monotonic()
        times["stop answered"].append(_ms(lambda: service.client.post(f"/runs/{run}/stop")))
        times["stop at the controller"].append(1000.0 * (simulated.do("halted")["at_s"] - begin))
        assert not simulated.do("state")["moving"]
        until(lambda: service.client.get(f"/runs/{run}").json()["state"] == "stopped", PATIENCE_S)
    return times


def _ms(ask: Callable[[], object]) -> float:
    begin = time.monotonic()
    ask()
    return 1000.0 * (time.monotonic() - begin)


@contextmanager
def _cell(folder: Path) -> Iterator[tuple[SimulatedCell, Path]]:
    """Simulators whose arm creeps, and the file of a cell with their addresses."""
    file = cell_file(folder, time_scale=1.0)
    command = [sys.executable, "-m", "tests.benchmarks.stop_cell", str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        try:
            assert process.stdout is not None
            simulated = SimulatedCell([process.stdout.readline() for _ in range(4)])
            text = file.read_text("utf-8").replace("tcp://192.168.125.1:5000", simulated.url("abb"))
            text = text.replace("tcp://127.0.0.1:5701", simulated.url("faro"))
            text = text.replace("speed_deg_s = 20.0", "speed_deg_s = 1.0")
            file.write_text(text, "utf-8")
            yield simulated, file
        finally:
            process.terminate()


@contextmanager
def _load(service: Served, run: str, data: Path, *load: str) -> Iterator[None]:
    """The 200 clients, or those of a `load`, and at the end how they were answered."""
    authorization = service.client.headers["authorization"]
    base = f"{service.url}/api/v1"
    command = [sys.executable, "-m", "tests.benchmarks.stop_load", base, authorization, run, str(data), *load]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=os.environ
    ) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        assert process.stdout.readline() == "ready\n"
        try:
            yield
        finally:
            process.stdin.close()
            told = json.loads(process.stdout.readline())
            kinds = ", ".join(f"{what}: {number}" for what, number in sorted(told["answered"].items()))
            print(f"answered meanwhile: {kinds}", flush=True)
            print(f"the clients took {100 * told['core']:.0f} % of a core", flush=True)
