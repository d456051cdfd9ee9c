"""The Fanuc driver over MAPPDK against the simulated controller: what the stock server of ROS-Industrial cannot do."""

from __future__ import annotations

import io
import json

import pytest

from drivers import (
    CannotStop,
    FanucDeadlines,
    LinkTimeout,
    NotArmed,
    ProtectiveStop,
    WireLog,
)
from tests.drivers.fanuc_cells import FAR, FAST, HASTY, SLOW, arm_of, cell_of
from tests.drivers.waiting import in_thread, until


def test_answer_to_a_move_before_the_robot_stands_is_not_the_reading() -> None:
    """A stock move ends in CNT: its answer comes too early, here by 0.7 s, and readings after it are on the way."""
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


def test_stock_cannot_be_stopped_and_says_so() -> None:
    with cell_of("mappdk", FAST) as cell:
        arm = arm_of("mappdk", cell)
        arm.connect()
        assert not arm.can_stop
        arm.arm()
        with pytest.raises(CannotStop):
            arm.stop()
        with pytest.raises(NotArmed):
            arm.move_to(FAR)
        arm.disconnect()


def test_robot_that_stands_on_its_way_is_a_protective_stop_long_before_the_deadline() -> None:
    with cell_of("mappdk", SLOW) as cell:
        arm = arm_of("mappdk", cell, deadlines=FanucDeadlines(still_s=0.3))
        arm.connect()
        arm.arm()
        move = in_thread(lambda: arm.move_to(FAR))
        until(lambda: cell.do("state")["moving"])
        cell.do("supervise")
        with pytest.raises(ProtectiveStop, match="still_s"):
            move.result(timeout=3)
        arm.disconnect()


def test_second_client_is_refused() -> None:
    with cell_of("mappdk", FAST) as cell:
        first = arm_of("mappdk", cell)
        first.connect()
        second = arm_of("mappdk", cell, deadlines=HASTY)
        with pytest.raises(LinkTimeout) as caught:
            second.connect()
        assert "no other program" in caught.value.what_to_do
        first.disconnect()
        second.connect()
        second.disconnect()
