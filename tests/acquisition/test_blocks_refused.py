"""Blocks that are refused: by the key that is wrong, or because this cell cannot do them."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.errors import ConfigError
from tests.acquisition.fakes import a_campaign
from tests.acquisition.test_blocks import TAUGHT, plan_of


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ({"kind": "sweep", "joint": 7}, "turns joint 7, the robot has 6"),
        ({"kind": "circle_point", "joints": [1, 9]}, "turns joint 9"),
        ({"kind": "sweep", "joint": 1, "at_deg": [1.0, 2.0]}, "at_deg has 2 joints, the robot 6"),
        ({"kind": "sphere", "centre_deg": TAUGHT}, "one target"),
        ({"kind": "sphere", "centre_deg": [0.0] * 5, "targets": ["T1"]}, "centre_deg has 5 joints"),
        ({"kind": "sphere", "centre_deg": [170.0, *TAUGHT[1:]], "targets": ["T1"]}, "outside the limits"),
        (
            {"kind": "sphere", "centre_deg": TAUGHT, "targets": ["T1"], "radius_mm": 2000.0},
            "reaches no point",
        ),
    ],
)
def test_what_this_cell_cannot_do(block: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        plan_of(block)


@pytest.mark.parametrize(
    ("block", "key"),
    [
        ({"kind": "dance"}, "kind"),
        ({"kind": "hexapod", "stages": 3}, "stages"),
        ({"kind": "hexapod", "configurations": "some"}, "configurations"),
        ({"kind": "sweep"}, "joint"),
        ({"kind": "sweep", "joint": 0}, "joint"),
        ({"kind": "sweep", "joint": 1, "count": 3}, "count"),
        ({"kind": "sweep", "joint": 1, "range_deg": [10, -10]}, "range_deg"),
        ({"kind": "sweep", "joint": 1, "range_deg": [1, 2, 3]}, "range_deg"),
        ({"kind": "sweep", "joint": 1, "range_deg": [0, 10], "step_deg": 20}, "step_deg"),
        ({"kind": "sweep", "joint": 1, "step_deg": 0}, "step_deg"),
        ({"kind": "sweep", "joint": 1, "at_deg": ["a"]}, "at_deg"),
        ({"kind": "sweep", "joint": 1, "both_ways": 1}, "both_ways"),
        ({"kind": "sweep", "joint": 1, "set": "repeat"}, "set"),
        ({"kind": "repeat", "visits": 1}, "visits"),
        ({"kind": "repeat", "order": "random"}, "order"),
        ({"kind": "repeat", "set": "calibration"}, "set"),
        ({"kind": "circle_point", "width_deg": 29.0}, "width_deg"),
        ({"kind": "circle_point", "step_deg": 10.0, "width_deg": 39.0}, "step_deg"),
        ({"kind": "circle_point", "joints": [1, 1]}, "joints"),
        ({"kind": "circle_point", "joints": [True]}, "joints"),
        ({"kind": "circle_point", "joint": 1}, "joint"),
        ({"kind": "sphere"}, "centre_deg"),
        ({"kind": "sphere", "centre_deg": TAUGHT, "radius_mm": 0.0}, "radius_mm"),
        ({"kind": "sphere", "centre_deg": TAUGHT, "above_deg": 90.0}, "above_deg"),
        ({"count": 1, "settle_s": -1.0}, "settle_s"),
        ({"count": 1, "settle_check": "yes"}, "settle_check"),
        ({"count": 1, "new_station": True}, "new_station"),
        ({"count": 1, "visits": 3}, "visits"),
        ({"count": 1, "approach": {"side": "both"}}, "approach.side"),
    ],
)
def test_blocks_refused_by_key(block: dict[str, Any], key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        a_campaign(block=[block])
    assert f"key 'block[0].{key}'" in str(caught.value), caught.value
    assert caught.value.exit_code == 2
