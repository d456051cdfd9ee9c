"""The Fanuc driver over MAPPDK on the simulated controller.

Limits of the stock server of ROS-Industrial.
"""

from __future__ import annotations

import io
import json

import pytest

from drivers import FanucDeadlines, ProtectiveStop, WireLog
from tests.drivers.fanuc_cells import FAR, SLOW, arm_of, cell_of
from tests.drivers.waiting import PATIENCE_S, under_way


def test_answer_to_a_move_before_the_robot_stands_is_not_the_reading() -> None:
    """A stock move ends in CNT, so its answer comes too early, here by 0.7 s.

    Readings after it are taken on the way.
    """
    log = io.StringIO()
    with cell_of("mappdk", SLOW) as cell:
        arm = arm_of("mappdk", cell, wire=WireLog(log), deadlines=FanucDeadlines(gap_s=0.02))
        arm.connect()
        arm.arm()
        assert cell.cell is not None
        cell.cell.fanuc.controller.cnt_lead_s = 0.7
        reached = arm.move_to((6.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        assert not cell.do("state")["moving"]
        arm.disconnect()
    heard = [row["data"] for row in map(json.loads, log.getvalue().splitlines()) if row["dir"] == "<"]
    after = heard[len(heard) - heard[::-1].index("0:success") :]
    first = float(next(text for text in after if text.startswith("0:j="))[4:12])
    assert 0.0 < first < 5.9
    assert reached.joints_deg[0] == 6.0


def test_robot_that_stands_on_its_way_is_a_protective_stop_long_before_the_deadline() -> None:
    with cell_of("mappdk", SLOW) as cell:
        arm = arm_of("mappdk", cell, deadlines=FanucDeadlines(still_s=0.3))
        arm.connect()
        arm.arm()
        move = under_way(arm, FAR, cell)
        cell.do("supervise")
        with pytest.raises(ProtectiveStop, match="still_s"):
            move.result(PATIENCE_S)
        arm.disconnect()
