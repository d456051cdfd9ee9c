"""Paths before the first motion: refusals as text, and samples that count as lost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from acquisition import Campaign, Cell, campaign_from, checked_plan, read_cell
from acquisition.campaign.plan import Forecast
from acquisition.errors import UnsafePlan
from acquisition.record import RecordStore
from acquisition.run.rig.recorder import Feed
from drivers import ConfigError, Sample
from tests.acquisition.fakes import a_cell

EXAMPLES = Path(__file__).parents[2] / "examples"
MIDDLE = [40.0, -105.0, 100.0, -85.0, -90.0, 0.0]
BESIDE = [60.0, *MIDDLE[1:]]


def ur() -> Cell:
    return read_cell(EXAMPLES / "ur5_leica" / "cell.toml")


def path(*joints_deg: list[float], **keys: Any) -> Campaign:
    waypoints = list(joints_deg) or [MIDDLE, BESIDE, MIDDLE]
    block = {"kind": "path", "select": "list", "targets": ["T1"], "joints_deg": waypoints} | keys
    return campaign_from({"format": "truepose-campaign/1", "block": [block]}, "campaign.toml")


def test_a_path_is_one_visit_and_comes_back_from_the_record(tmp_path: Path) -> None:
    visits = checked_plan(ur(), path())
    (visit,) = (visit for visit in visits if visit.kind == "pose")
    assert [visit.joints_deg, *visit.waypoints] == [tuple(MIDDLE), tuple(BESIDE), tuple(MIDDLE)]
    store = RecordStore.create(tmp_path, "ur", ur().source, path().source, visits, simulated=True)
    assert [planned.visit for planned in store.left("planned")] == [visit]
    store.close()


def test_a_cell_that_cannot_stream_is_refused_in_a_sentence() -> None:
    with pytest.raises(
        ConfigError, match=r"robot \(driver 'abb'\) and the instrument \(driver 'faro'\) of this cell"
    ):
        checked_plan(a_cell(), path())


@pytest.mark.parametrize(
    ("waypoint", "words"),
    [
        ([40.0, 0.0, *MIDDLE[2:]], "waypoint 2 of path of 3 waypoints .*joint 2 at 0 deg"),
        ([40.0, -20.0, 60.0, *MIDDLE[3:]], "waypoint 2 of path of 3 waypoints"),
    ],
    ids=["limits", "table"],
)
def test_every_waypoint_is_checked_before_the_first_motion(waypoint: list[float], words: str) -> None:
    with pytest.raises(UnsafePlan, match=words):
        checked_plan(ur(), path(MIDDLE, waypoint, MIDDLE))


def test_a_path_needs_waypoints_and_one_target() -> None:
    with pytest.raises(ConfigError, match=r"gives 2 waypoints\. A path needs 3 or more"):
        path(MIDDLE, BESIDE, MIDDLE, select="random", count=2)
    with pytest.raises(ConfigError, match="gives 2 waypoints"):
        campaign_from(
            {
                "format": "truepose-campaign/1",
                "block": [{"kind": "path", "select": "list", "joints_deg": [MIDDLE, BESIDE]}],
            },
            "campaign.toml",
            beside=EXAMPLES,
        )


def test_a_speed_of_its_own_is_held_against_the_cells_and_counted() -> None:
    with pytest.raises(ConfigError, match=r"block 1: speed_deg_s = 25 is faster than the cell allows"):
        checked_plan(ur(), path(speed_deg_s=25.0))
    times = {}
    for speed in (20.0, 4.0):
        campaign = path(speed_deg_s=speed)
        times[speed] = Forecast.of(ur(), campaign, checked_plan(ur(), campaign)).total_s
    # 20 deg there and 20 deg back, in 5 s each instead of 1 s
    assert times[4.0] - times[20.0] == pytest.approx(8.0)
    assert times[20.0] == Forecast.of(ur(), path(), checked_plan(ur(), path())).total_s


def test_lost_samples_are_counted_by_number_else_by_the_clock() -> None:
    counted, timed = Feed("instrument", 10.0), Feed("robot", 125.0)
    for t_s, number in ((0.0, 5), (0.1, 6), (0.5, 10), (0.6, 11)):
        counted.take(Sample(t_s, (1.0, 2.0, 3.0), number), 0.0)
    for t_s in (7.0, 7.008, 7.032, 7.0401):
        timed.take(Sample(t_s, (0.0,) * 6), 0.0)
    assert [sample.lost for sample in counted.waiting] == [0, 0, 3, 0]
    assert [sample.lost for sample in timed.waiting] == [0, 0, 2, 0]
