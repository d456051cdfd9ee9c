"""A scheduler of its own: workers of another program get nothing, and its death costs nothing that was done."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from fleet.diagnose.batch import Order
from fleet.diagnose.call import diagnose_all
from fleet.diagnose.errors import EngineGone
from fleet.diagnose.source import in_files
from fleet.diagnose.tally import Tally
from fleet.store import Store
from tests.drivers.nobody import nobody_listens
from tests.fleet.diagnose.sets import bad

ROOT = Path(__file__).parents[3]


@contextmanager
def program(*words: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A program of `tests.fleet.diagnose.programs`, and the address that it prints when it listens."""
    command = [sys.executable, "-m", "tests.fleet.diagnose.programs", *words]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            assert process.stdout is not None
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


def quiet(_: object) -> None:
    """Hears nothing."""


def test_other_programs_get_nothing_and_a_killed_scheduler_loses_nothing(tmp_path: Path) -> None:
    sources = in_files([bad(tmp_path, f"bad{i}") for i in range(40)])
    order = Order(f"sqlite:///{tmp_path}/s.sqlite3", "first", lease_s=1.0)
    told: list[str] = []
    with ExitStack() as running:
        scheduler, address = running.enter_context(program("scheduler"))
        _, wrong = running.enter_context(program("worker", address, "0.0.9+other"))
        running.enter_context(program("worker", address, ""))

        def kill(tally: Tally) -> None:
            if tally.done >= 2:
                scheduler.kill()

        with pytest.raises(EngineGone, match="scheduler is gone"):
            diagnose_all(sources, order, told.append, kill, scheduler=address)
    refusals = [each for each in told if "refused" in each]
    assert len(refusals) == 1
    assert wrong in refusals[0]
    assert "it runs TruePose 0.0.9+other" in refusals[0]

    with Store.open(order.store) as store:
        first = store.work.results(order.task)
    assert 2 <= len(first) < 40
    again = replace(order, owner="second")
    with ExitStack() as running:
        _, address = running.enter_context(program("scheduler"))
        running.enter_context(program("worker", address, ""))
        tally = diagnose_all(sources, again, quiet, quiet, scheduler=address)
    assert (tally.found, tally.done, tally.twice, tally.failed) == (len(first), 40 - len(first), 0, {})
    with Store.open(order.store) as store:
        results = store.work.results(order.task)
    assert results[: len(first)] == first  # written once
    assert len({each.job.data for each in results}) == len(results) == 40


def test_where_no_scheduler_answers_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fleet.diagnose.engine.CONNECT_S", 0.5)
    sources = in_files([bad(tmp_path, "bad")])
    order = Order(f"sqlite:///{tmp_path}/s.sqlite3", "first")
    with nobody_listens() as port, pytest.raises(EngineGone, match="no scheduler answers"):
        diagnose_all(sources, order, quiet, quiet, scheduler=f"tcp://127.0.0.1:{port}")
