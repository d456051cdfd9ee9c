"""The instrument is moved during a campaign.

Nothing is measured in the old frame from the new station. These would catch: a pose measured before the nests are,
nests measured without a request to set up the instrument, and a station that is not counted. They would also catch an
order given twice for one key, and earlier readings that are transformed again.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from acquisition.cell.world_frame import WorldFrame
from acquisition.errors import NotResumed
from acquisition.run.run import Run
from drivers.interfaces import Answer, Prompt
from tests.acquisition.fakes import Bench, JumpingClock, SeatingOperator, a_campaign, a_cell, devices_of

SET_UP = "Set up the instrument where it is to be, then confirm: the nests are measured there."
ELSEWHERE = WorldFrame(
    np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.array([100.0, 3000.0, 0.0])
)


class Mover(SeatingOperator):
    """Carries the tracker elsewhere when asked to."""

    def ask(self, prompt: Prompt) -> Answer:
        if prompt.text == SET_UP:
            self.bench.tracker = ELSEWHERE
        return super().ask(prompt)


@contextmanager
def a_run(folder: Path) -> Iterator[tuple[Bench, Run]]:
    bench = Bench(a_cell())
    with Run.create(folder / "record", bench.cell, a_campaign(), simulated=True) as run:
        yield bench, run


def worlds(run: Run) -> dict[tuple[str, str], list[float]]:
    """Return the world positions of the good readings of poses, by pose name and target."""
    return {
        (event.data["name"], event.data["target"]): event.data["world_mm"]
        for event in run.events()
        if event.kind == "reading" and event.data["target"].startswith("T")
    }


def test_in_mid_run_the_nests_come_before_the_next_pose(tmp_path: Path) -> None:
    with a_run(tmp_path / "still") as (bench, run):
        run.execute(devices_of(bench, SeatingOperator(bench)), JumpingClock())
        expected = worlds(run)
    with a_run(tmp_path / "moved") as (bench, run):
        bench.faults[10] = lambda: run.restation("anna", "a forklift needs the place")  # while T1 is measured
        operator = Mover(bench)
        assert run.execute(devices_of(bench, operator), JumpingClock()).state.value == "succeeded"
        assert operator.asked == [SET_UP]
        assert bench.log[9] == "measure T1"
        assert bench.log[10:13] == ["measure N1", "measure N2", "measure N3"]
        assert bench.log[13:16] == ["move", "move", "measure T2"]  # approached anew
        now = worlds(run)
        assert now.keys() == expected.keys()
        for place, world in now.items():
            np.testing.assert_allclose(world, expected[place], atol=1e-6)
        (told,) = [event.data for event in run.events() if event.kind == "restation"]
        assert told == {"by": "anna", "reason": "a forklift needs the place"}
        (again,) = [event.data["reason"] for event in run.events() if event.kind == "measure_again"]
        assert again == "a new station of the instrument: a forklift needs the place"
        assert "2 stations" in run.status().reason


def test_an_order_that_changes_nothing_costs_three_nests(tmp_path: Path) -> None:
    with a_run(tmp_path) as (bench, run):

        def order_twice() -> None:
            for _ in range(2):
                run.restation("anna", key="once")

        bench.faults[10] = order_twice
        assert (
            run.execute(devices_of(bench, SeatingOperator(bench)), JumpingClock()).state.value == "succeeded"
        )
        assert bench.log.count("measure N1") == 2
        assert "stations" not in run.status().reason
        assert len([event for event in run.events() if event.kind == "restation"]) == 1


def test_while_it_is_paused_the_order_is_noted_and_the_next_execution_begins_with_the_nests(
    tmp_path: Path,
) -> None:
    with a_run(tmp_path) as (bench, run):
        bench.faults[10] = lambda: run.pause("anna")
        devices = devices_of(bench, SeatingOperator(bench))
        assert run.execute(devices, JumpingClock()).state.value == "paused"
        bench.tracker = ELSEWHERE
        run.restation("anna", "moved at noon")
        run.resume(by="anna")
        calls = len(bench.log)
        assert run.execute(devices, JumpingClock()).state.value == "succeeded"
        assert [name for name in bench.log[calls:] if "measure" in name][:3] == [
            "measure N1",
            "measure N2",
            "measure N3",
        ]
        assert "2 stations" in run.status().reason
        with pytest.raises(NotResumed, match="has succeeded"):
            run.restation("anna")
