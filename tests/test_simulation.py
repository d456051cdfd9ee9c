"""Test fixed seeds of the simulation in separate processes.

A simulation replaces modules for good. Seeds that once showed a defect stay in the list.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest

from tests.service.test_http_support import ROOT

PARTS, CAMPAIGNS = 2, 80
# The full disk while a run is created: its folder stayed as a damaged run, and its lock as that of another program.
ONCE_DEFECTS = (25,)


def simulated(*options: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tests.simulation", *options]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=os.environ | environment)


def log_of(said: str) -> str:
    found = re.search(r"log (\w{16})$", said.strip())
    assert found, said
    return found[1]


@pytest.mark.parametrize("part", range(PARTS))
def test_histories_end_in_peace(part: int) -> None:
    done = simulated("--seed", str(1 + 1000 * part), "--campaigns", str(CAMPAIGNS))
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("seed", ONCE_DEFECTS)
def test_what_was_mended_stays_mended(seed: int) -> None:
    done = simulated("--seed", str(seed))
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_seed_has_the_same_log_in_every_process() -> None:
    logs = {log_of(simulated("--campaigns", "4", PYTHONHASHSEED=number).stdout) for number in ("1", "2")}
    assert len(logs) == 1


_BROKEN = """
from tests.simulation.__main__ import describe, play, shortest
from tests.simulation.histories import steps_of
from acquisition.run.orders.control import Control

Control.pause = lambda self, reason="": None
seed = next(seed for seed in range(1, 300) if play(seed, steps_of(seed)).found)
print(describe(shortest(seed, steps_of(seed)), log=False))
"""


def test_a_fault_is_shown_with_the_steps_that_it_needs() -> None:
    done = subprocess.run([sys.executable, "-c", _BROKEN], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "the robot moves" in done.stdout
    steps = re.findall(r"^ +[\d.]+ s  (\w+: .*)$", done.stdout, re.MULTILINE)
    assert 1 < len(steps) <= 4  # the lease is taken, a run is started and paused
    assert '--only "' in done.stdout
