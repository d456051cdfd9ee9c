"""All rigs of the conformance suite by name; those of ABB and FARO are here."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

from drivers import AbbArm, AbbDeadlines, FaroTracker, MbpDeadlines
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.faultproxy import FaultProxy
from tests.conformance.fanuc_rigs import FANUC_RIGS
from tests.conformance.instrument_rigs import INSTRUMENT_RIGS
from tests.conformance.rig import SCALE, Rig
from tests.conformance.ur_rigs import UR_RIGS

PATIENT_ABB = AbbDeadlines(move_margin_s=5.0, ping_s=5.0, reply_s=5.0, stop_s=5.0, quiet_s=0.05)
HASTY_ABB = replace(PATIENT_ABB, move_margin_s=0.3, move_factor=0.0, ping_s=0.3, reply_s=0.3, stop_s=0.3)
PATIENT_FARO = MbpDeadlines()
HASTY_FARO = MbpDeadlines(reply_s=0.3, point_s=0.3, measure_margin_s=0.3)


def abb_rig(stack: ExitStack, *, stock: bool) -> Rig:
    """Question i: go to a pose of its own, and read it back."""
    cell = stack.enter_context(CellThread(CellFile(time_scale=SCALE, effects=("none",)), stock=stock))
    proxy = stack.enter_context(FaultProxy(cell.port("abb")))
    arm = AbbArm(f"tcp://127.0.0.1:{proxy.port}?background={cell.port('abb-background')}")
    stack.callback(arm.disconnect)

    def ask(i: int) -> float:
        target = (10.0 + i % 70, 5.0 + i % 13, -(i % 29) - 1.0, i % 41 + 1.0, i % 17 + 1.0, -(i % 90) - 1.0)
        reached = arm.move_to(target).joints_deg
        read = arm.position().joints_deg
        return max(
            math.dist(reached, target),
            math.dist(read, target),
            math.dist(read, cell.cell.arm.joints_deg()) if cell.cell else math.inf,
        )

    return Rig(arm, proxy, cell, ask, 0.006 if stock else 1e-5, 6 * HASTY_ABB.reply_s, PATIENT_ABB, HASTY_ABB)


def faro_rig(stack: ExitStack) -> Rig:
    """Question i: one of six targets, metres apart compared with the tolerance."""
    cell = stack.enter_context(CellThread(CellFile(time_scale=SCALE, effects=("none",))))
    proxy = stack.enter_context(FaultProxy(cell.port("faro"), boundary=b"\n"))
    tracker = FaroTracker(f"tcp://127.0.0.1:{proxy.port}", heartbeat_s=None)
    stack.callback(tracker.disconnect)
    names = ("T1", "N1", "T2", "N2", "T3", "N3")

    def ask(i: int) -> float:
        name = names[i % len(names)]
        reading = tracker.measure(name, samples=10)
        assert reading.target == name
        assert cell.cell is not None
        device = cell.cell.tracker
        return math.dist(reading.xyz_mm, device.to_tracker(device.true_world(name)))

    return Rig(tracker, proxy, cell, ask, 0.5, 2 * HASTY_FARO.reply_s + 0.1, PATIENT_FARO, HASTY_FARO)


RIGS: dict[str, Callable[[ExitStack], Rig]] = {
    "abb-calsrv": lambda stack: abb_rig(stack, stock=False),
    "abb-stock": lambda stack: abb_rig(stack, stock=True),
    "faro-mbp1": faro_rig,
    **FANUC_RIGS,
    **UR_RIGS,
    **INSTRUMENT_RIGS,
}
