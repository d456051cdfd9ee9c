"""A robot that ends its move near its target has not arrived.

The report of its controller does not matter.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import pytest

from drivers import (
    AbbArm,
    AbbSimpleArm,
    FanucArm,
    MotionStopped,
    NotArmed,
    NotReached,
    UrArm,
    YaskawaArm,
    open_robot,
)
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.yaskawa.controller import MAX_DEG_S, PULSES_PER_DEG

CELL = CellFile(time_scale=5000.0, effects=("none",))
BESIDE_DEG = 0.2  # more than any servo leaves, less than anybody sees
ARMS: dict[str, tuple[Any, str, dict[str, float]]] = {  # driver, robot of the cell, waits that pass in vain
    "abb": (AbbArm, "abb-irb120", {}),
    "abb-simple": (AbbSimpleArm, "abb-irb120", {"still_s": 0.3}),
    "fanuc": (FanucArm, "fanuc-lrmate200ic", {"settle_s": 0.3}),
    "fanuc-rmi": (partial(open_robot, "fanuc-rmi"), "fanuc-lrmate200ic", {"settle_s": 0.3}),
    "ur": (UrArm, "ur5", {"settle_s": 0.3}),
    "yaskawa": (
        partial(YaskawaArm, pulses_per_deg=PULSES_PER_DEG, max_deg_s=MAX_DEG_S),
        "yaskawa-gp7",
        {"settle_s": 0.3},
    ),
}


@pytest.mark.parametrize("kind", ARMS)
def test_beside_the_target_is_not_there(kind: str) -> None:
    made, robot, hasty = ARMS[kind]
    with CellThread(replace(CELL, robot=robot), devices=(kind,)) as cell:
        arm = made(cell.url(kind))
        arm.connect()
        arm.arm()
        arm.move_to((5.0, 10.0, 0.0, 0.0, 10.0, 0.0))
        assert cell.cell is not None
        start = cell.cell.arm.start

        def beside(target: tuple[float, ...], rate_deg_s: float, tool_mm_s: float) -> None:
            start((target[0] + BESIDE_DEG, *target[1:]), rate_deg_s, tool_mm_s)

        cell.cell.arm.start = beside  # type: ignore[method-assign, assignment]
        if hasty:
            arm.deadlines = replace(arm.deadlines, **hasty)
        with pytest.raises((NotReached, MotionStopped)):
            arm.move_to((20.0, 10.0, 0.0, 0.0, 10.0, 0.0))
        with pytest.raises(NotArmed):
            arm.move_to((5.0, 10.0, 0.0, 0.0, 10.0, 0.0))
        arm.disconnect()
