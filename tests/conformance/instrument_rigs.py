"""Rigs of the instruments, behind a bridge and of emScon."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np

from drivers import (
    CTrack,
    EmsconTracker,
    FaroTracker,
    InstrumentDeadlines,
    LeicaTracker,
    PointReading,
    PoseReading,
    Qc20w,
)
from mocks.cell import CellThread, make_world
from mocks.cell_file import CellFile
from mocks.faultproxy import FaultProxy
from mocks.world import ArmState
from service.conformance import DriverRig
from tests.conformance.truth import SCALE

NAMES = ("T1", "N1", "T2", "N2", "T3", "N3")
PATIENT = InstrumentDeadlines()
HASTY = replace(PATIENT, reply_s=0.3, point_s=0.3, measure_margin_s=0.3)
HASTY_EMSCON = replace(HASTY, measure_margin_s=-0.2)  # 0.5 s at least


def _cell(
    stack: ExitStack, device: str, file: CellFile | None = None, boundary: bytes = b"\n"
) -> tuple[CellThread, FaultProxy]:
    file = file or CellFile(time_scale=SCALE, effects=("none",))
    cell = stack.enter_context(CellThread(file, devices=(device,)))
    return cell, stack.enter_context(FaultProxy(cell.port(device), boundary=boundary, device=cell.do))


def _asks(meter: Any, miss: Callable[[Any], float]) -> Callable[[int], float]:
    """Question i: one of six names, and by how much its reading misses."""

    def ask(i: int) -> float:
        name = NAMES[i % len(NAMES)]
        reading = meter.measure(name, samples=10)
        assert reading.target == name
        return miss(reading)

    return ask


def tracker_rig(stack: ExitStack, driver: type[FaroTracker | LeicaTracker], device: str) -> DriverRig:
    """Question i: one of six targets, metres apart compared with the tolerance."""
    cell, proxy = _cell(stack, device)
    tracker = driver(f"tcp://127.0.0.1:{proxy.port}", heartbeat_s=None)
    stack.callback(tracker.disconnect)

    def miss(reading: PointReading) -> float:
        assert cell.cell is not None
        simulated = cell.cell.tracker if device == "faro" else cell.cell.at960
        return math.dist(reading.xyz_mm, simulated.to_tracker(simulated.true_world(reading.target)))

    return DriverRig(
        tracker, proxy, cell.do, _asks(tracker, miss), 0.5, 2 * HASTY.reply_s + 0.1, PATIENT, HASTY
    )


def emscon_rig(stack: ExitStack) -> DriverRig:
    """Question i: one of six places to point at. A message is one piece received: packets have no end mark."""
    cell, proxy = _cell(stack, "emscon", boundary=b"")
    tracker = EmsconTracker(f"tcp://127.0.0.1:{proxy.port}")
    stack.callback(tracker.disconnect)
    assert cell.cell is not None
    device = cell.cell.at960
    places: Sequence[tuple[float, ...]] = [
        tuple(float(v) for v in device.to_tracker(device.true_world(name))) for name in NAMES
    ]

    def ask(i: int) -> float:
        at = i % len(NAMES)
        return math.dist(tracker.measure(NAMES[at], samples=10, near_mm=places[at]).xyz_mm, places[at])

    return DriverRig(tracker, proxy, cell.do, ask, 0.5, 2 * HASTY_EMSCON.reply_s + 0.5, PATIENT, HASTY_EMSCON)


def ctrack_rig(stack: ExitStack) -> DriverRig:
    """Build the rig; question i measures one of six bodies.

    The miss is in mm or in tenths of a mrad, whichever is larger.
    """
    cell, proxy = _cell(stack, "ctrack")
    meter = CTrack(f"tcp://127.0.0.1:{proxy.port}", heartbeat_s=None)
    stack.callback(meter.disconnect)

    def miss(reading: PoseReading) -> float:
        assert cell.cell is not None
        device = cell.cell.ctrack.device
        true = device.to_reference(device.frame(reading.target))
        w, x, y, z = reading.rot_wxyz
        along_x = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
        return max(math.dist(reading.xyz_mm, true[:3, 3]), 100.0 * math.dist(along_x, true[:3, 0]))

    return DriverRig(meter, proxy, cell.do, _asks(meter, miss), 0.5, 2 * HASTY.reply_s + 0.1, PATIENT, HASTY)


def ballbar_rig(stack: ExitStack, scheme: str) -> DriverRig:
    """Build the rig; question i measures one of four base balls.

    Their lengths differ by 0.3 mm, a hundred times the tolerance.
    """
    world = make_world(CellFile(effects=("none",)))
    place = np.array(world.true_point(ArmState((0.0,) * 6, (0.0,) * 6, (1,) * 6), "T1"))
    turns = [np.array([math.cos(a), math.sin(a), -1.0]) / math.sqrt(2.0) for a in (0.0, 1.0, 2.0, 3.0)]
    balls = {
        f"B{i}": tuple(map(float, place + (299.5 + 0.3 * i) * turn)) for i, turn in enumerate(turns, start=1)
    }
    cell, proxy = _cell(stack, "qc20w", CellFile(time_scale=SCALE, effects=("none",), nests=balls))
    meter = Qc20w(f"{scheme}://127.0.0.1:{proxy.port}", nominal_mm=300.0, heartbeat_s=None)
    stack.callback(meter.disconnect)

    def ask(i: int) -> float:
        base = f"B{1 + i % len(balls)}"
        reading = meter.measure("T1", base_target=base, samples=10)
        assert reading.base_target == base
        return abs(reading.length_mm - math.dist(place, balls[base]))

    # The arm comes to rest within some 0.02 mm, the zero creeps by 0.003 mm.
    return DriverRig(meter, proxy, cell.do, ask, 0.08, 2 * HASTY.reply_s + 0.1, PATIENT, HASTY)


INSTRUMENT_RIGS: dict[str, Callable[[ExitStack], DriverRig]] = {
    "faro-mbp1": lambda stack: tracker_rig(stack, FaroTracker, "faro"),
    "leica-mbp1": lambda stack: tracker_rig(stack, LeicaTracker, "leica"),
    "leica-emscon": emscon_rig,
    "ctrack-mbp1": ctrack_rig,
    "qc20w-mbp1": lambda stack: ballbar_rig(stack, "tcp"),
    "qc20w-serial": lambda stack: ballbar_rig(stack, "socket"),
}
