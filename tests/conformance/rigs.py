"""All rigs of the conformance suite by name; that of FARO is here."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack

from drivers import FaroTracker, InstrumentDeadlines
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.faultproxy import FaultProxy
from tests.conformance.abb_rigs import ABB_RIGS
from tests.conformance.fanuc_rigs import FANUC_RIGS
from tests.conformance.instrument_rigs import INSTRUMENT_RIGS
from tests.conformance.rig import SCALE, Rig
from tests.conformance.ur_rigs import UR_RIGS

PATIENT_FARO = InstrumentDeadlines()
HASTY_FARO = InstrumentDeadlines(reply_s=0.3, point_s=0.3, measure_margin_s=0.3)


def faro_rig(stack: ExitStack) -> Rig:
    """Question i: one of six targets, metres apart compared with the tolerance."""
    cell = stack.enter_context(CellThread(CellFile(time_scale=SCALE, effects=("none",))))
    proxy = stack.enter_context(FaultProxy(cell.port("faro"), boundary=b"\n", device=cell.do))
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
    **ABB_RIGS,
    "faro-mbp1": faro_rig,
    **FANUC_RIGS,
    **UR_RIGS,
    **INSTRUMENT_RIGS,
}
# What comes back on this connection is used once, to see that a controller is there: only its requests are spoiled.
REQUESTS_ONLY = {"ur-program"}
# Where the robot moves on one request, which nobody confirms: a damaged one may send it elsewhere.
MOVE_AT_ONCE = {"abb-stock", "abb-simple-motion", "fanuc-mappdk", "ur-realtime"}
