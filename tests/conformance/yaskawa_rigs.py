"""Rigs of the Yaskawa: HSES, behind a proxy of datagrams."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import Any

from drivers import YaskawaArm, YaskawaDeadlines
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.faultproxy import DatagramProxy
from mocks.yaskawa.controller import MAX_DEG_S, PULSES_PER_DEG
from service.conformance import DriverRig
from tests.conformance.truth import SCALE, sent_elsewhere

CELL = CellFile(robot="yaskawa-gp7", time_scale=SCALE, effects=("none",))
NUMBERS: dict[str, Any] = {"pulses_per_deg": PULSES_PER_DEG, "max_deg_s": MAX_DEG_S}
# A closed port shows when a question is repeated: one answer is not waited for long, and several times.
PATIENT = YaskawaDeadlines(
    reply_s=0.3, tries=12, start_s=30.0, settle_s=30.0, gap_s=0.001, move_margin_s=30.0
)
HASTY = replace(PATIENT, reply_s=0.05, tries=2, start_s=0.1, settle_s=0.1, move_factor=0.0, move_margin_s=0.1)
PULSE_DEG = 1.0 / min(PULSES_PER_DEG)


def yaskawa_rig(stack: ExitStack) -> DriverRig:
    """Build the rig; question i goes to a distinct pose and reads it back."""
    cell = stack.enter_context(CellThread(CELL, devices=("yaskawa",)))
    proxy = stack.enter_context(DatagramProxy(cell.port("yaskawa"), device=cell.do))
    arm = YaskawaArm(f"udp://127.0.0.1:{proxy.port}", **NUMBERS)
    stack.callback(arm.disconnect)
    goals: list[tuple[float, ...]] = []

    def ask(i: int) -> float:
        target = (10.0 + i % 70, 5.0 + i % 13, i % 29 + 1.0, i % 41 + 1.0, i % 17 + 1.0, -(i % 90) - 1.0)
        goals.append(target)
        reached = arm.move_to(target).joints_deg
        read = arm.position().joints_deg
        assert cell.cell is not None
        truth = cell.cell.arm.joints_deg()
        pairs = ((reached, target), (read, target), (read, truth))
        return max(abs(a - b) for one, other in pairs for a, b in zip(one, other, strict=True))

    elsewhere = partial(sent_elsewhere, cell, goals, PULSE_DEG)
    longest_s = 20 * HASTY.reply_s + HASTY.start_s + HASTY.settle_s
    # Two readings of a robot at rest may differ by two pulses.
    return DriverRig(arm, proxy, cell.do, ask, 2.5 * PULSE_DEG, longest_s, PATIENT, HASTY, elsewhere)


YASKAWA_RIGS: dict[str, Callable[[ExitStack], DriverRig]] = {"yaskawa-hses": yaskawa_rig}
