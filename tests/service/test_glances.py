"""Glances at a run: a kept answer must equal a new reading of the record.

These would catch: an answer older than the last entry of the record, and a remaining time that does not change. They
would also catch a run at rest that is not checked any more, and an answer that reads the record each time.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import pytest

from acquisition import Run
from service.http.runs.run_cache import KEPT_S, RunCache
from service.http.runs.run_document import run_document
from service.http.runs.run_manager import RunManager
from service.http.work.readings import DocumentCache
from tests.acquisition.fakes import a_campaign, a_cell


@dataclass
class Looked:
    """A book of one run; how often it was read, and whether that run uses the robot."""

    run: Run
    busy: bool = True
    times: int = 0
    now_s: float = 100.0

    def changes(self, name: str) -> int | None:
        return self.run.changes if self.busy and name == "r" else None

    def document(self, name: str) -> dict[str, Any]:
        self.times += 1
        return run_document(name, self.run.status())

    def glances(self) -> RunCache:
        return RunCache(cast(RunManager, self), DocumentCache(2), lambda: self.now_s)


def test_it_is_read_again_for_every_change_and_after_a_moment(tmp_path: Path) -> None:
    with Run.create(tmp_path / "r", a_cell(), a_campaign()) as run:
        asyncio.run(_at(Looked(run)))


async def _at(looked: Looked) -> None:
    glances = looked.glances()
    first = await glances("r")
    for _ in range(50):
        assert await glances("r") is first
    assert looked.times == 1
    looked.run.pause(by="anna")
    assert (await glances("r")).version == looked.run.status().version > first.version
    assert looked.times == 2
    looked.now_s += 0.9 * KEPT_S
    await glances("r")
    assert looked.times == 2
    looked.now_s += 0.2 * KEPT_S
    await glances("r")
    assert looked.times == 3
    await glances.anew("r")
    await glances("other")  # nor does one run answer for another
    await glances("r")
    assert looked.times == 6
    looked.busy = False  # errors and robot are what they are without a change of the record
    for _ in range(3):
        await glances("r")
    assert looked.times == 9


def test_a_change_that_came_while_it_was_read_is_not_missed(tmp_path: Path) -> None:
    class Slow(Looked):
        def document(self, name: str) -> dict[str, Any]:
            document = super().document(name)
            if self.times == 1:
                self.run.pause(by="anna")
            return document

    async def look(looked: Looked) -> tuple[int, int]:
        glances = looked.glances()
        return (await glances("r")).version, (await glances("r")).version

    with Run.create(tmp_path / "r", a_cell(), a_campaign()) as run:
        early, late = asyncio.run(look(Slow(run)))
        assert early < late == run.status().version


def test_only_what_was_written_counts_as_a_change(tmp_path: Path) -> None:
    with Run.create(tmp_path / "r", a_cell(), a_campaign()) as run:
        before = run.changes
        run.pause(by="anna", key="once")
        assert run.changes > before
        before = run.changes
        with pytest.raises(ZeroDivisionError):
            _give_up(run)
        assert run.changes == before


def _give_up(run: Run) -> None:
    with run._store.changing():
        run._store.add_event("nothing")
        raise ZeroDivisionError
