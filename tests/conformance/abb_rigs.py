"""Rigs of the ABB driver: open_abb, abb_driver with a proxied port, and Robot Web Services.

The server of open_abb is the stock or the custom one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial

from drivers import AbbArm, AbbDeadlines, AbbSimpleArm, AbbSimpleDeadlines
from drivers.abb.rws import RwsAccess, RwsSession
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.faultproxy import FaultProxy
from service.conformance import DriverRig
from tests.conformance.truth import SCALE, sent_elsewhere

PATIENT_ABB = AbbDeadlines(
    move_margin_s=30.0,
    ping_s=30.0,
    reply_s=30.0,
    stop_s=30.0,
    quiet_s=0.05,
    settle_s=30.0,
    gap_s=0.01,
    rws_s=30.0,
)
HASTY_ABB = replace(
    PATIENT_ABB,
    move_margin_s=0.3,
    move_factor=0.0,
    ping_s=0.3,
    reply_s=0.3,
    stop_s=0.3,
    settle_s=0.1,
    rws_s=0.3,
)
PATIENT_SIMPLE = AbbSimpleDeadlines(reply_s=30.0, stop_s=30.0, settle_s=30.0)
HASTY_SIMPLE = replace(
    PATIENT_SIMPLE, connect_s=0.3, takeover_s=0.1, reply_s=0.3, stop_s=0.3, settle_s=0.3, move_margin_s=0.3
)
FILE = CellFile(time_scale=SCALE, effects=("none",))


def goal(i: int) -> tuple[float, ...]:
    """Return a distinct pose for question i."""
    return (10.0 + i % 70, 5.0 + i % 13, -(i % 29) - 1.0, i % 41 + 1.0, i % 17 + 1.0, -(i % 90) - 1.0)


def gone(
    arm: AbbArm | AbbSimpleArm, cell: CellThread, goals: list[tuple[float, ...]], i: int
) -> list[tuple[Sequence[float], Sequence[float]]]:
    """Go to the pose of question i and return two readings, each with the right value, deg.

    The first is read on arrival, the second afterwards.
    """
    target = goal(i)
    goals.append(target)
    reached = arm.move_to(target).joints_deg
    read = arm.position().joints_deg
    assert cell.cell is not None
    return [(reached, target), (read, target), (read, cell.cell.arm.joints_deg())]


def abb_rig(stack: ExitStack, *, stock: bool) -> DriverRig:
    """Build the rig; question i goes to a distinct pose and reads it back."""
    cell = stack.enter_context(CellThread(FILE, stock=stock))
    proxy = stack.enter_context(FaultProxy(cell.port("abb"), device=cell.do))
    arm = AbbArm(f"tcp://127.0.0.1:{proxy.port}?background={cell.port('abb-background')}")
    stack.callback(arm.disconnect)
    goals: list[tuple[float, ...]] = []

    def ask(i: int) -> float:
        return max(math.dist(got, right) for got, right in gone(arm, cell, goals, i))

    tolerance, longest_s = 0.006 if stock else 1e-5, 6 * HASTY_ABB.reply_s
    elsewhere = partial(sent_elsewhere, cell, goals, 1e-5)
    return DriverRig(arm, proxy, cell.do, ask, tolerance, longest_s, PATIENT_ABB, HASTY_ABB, elsewhere)


def abb_simple_rig(stack: ExitStack, *, proxied: str) -> DriverRig:
    """Build the rig; question i goes to a distinct pose and reads it back.

    Messages have no end mark and no checksum.
    """
    cell = stack.enter_context(CellThread(FILE, devices=("abb-simple",)))
    proxy = stack.enter_context(FaultProxy(cell.port(proxied), device=cell.do))
    ports = {name: cell.port(name) for name in ("abb-simple", "abb-simple-state")} | {proxied: proxy.port}
    arm = AbbSimpleArm(f"tcp://127.0.0.1:{ports['abb-simple']}?state={ports['abb-simple-state']}")
    stack.callback(arm.disconnect)
    goals: list[tuple[float, ...]] = []

    def ask(i: int) -> float:
        pairs = gone(arm, cell, goals, i)
        return max(abs(a - b) for got, right in pairs for a, b in zip(got, right, strict=True))

    # 0.002 deg: states of a standing robot may differ by so much, so a wrong bit below that is believed.
    longest_s = (
        2 * HASTY_SIMPLE.reply_s + HASTY_SIMPLE.settle_s + 4 * HASTY_SIMPLE.stop_s + HASTY_SIMPLE.takeover_s
    )
    elsewhere = partial(sent_elsewhere, cell, goals, 1e-4)
    return DriverRig(arm, proxy, cell.do, ask, 0.0021, longest_s, PATIENT_SIMPLE, HASTY_SIMPLE, elsewhere)


class WebReader:
    """Robot Web Services alone, which the driver asks in a separate thread without waiting."""

    name = "abb"

    def __init__(self, access: RwsAccess) -> None:
        self._deadlines = PATIENT_ABB
        self.session = RwsSession(access, "abb-rws", PATIENT_ABB.rws_s)

    @property
    def deadlines(self) -> AbbDeadlines:
        return self._deadlines

    @deadlines.setter
    def deadlines(self, deadlines: AbbDeadlines) -> None:
        self._deadlines, self.session.limit_s = deadlines, deadlines.rws_s

    def connect(self) -> None:
        self.session.abort()
        self.session.version()

    def arm(self) -> None:
        """Nothing is armed."""


def abb_rws_rig(stack: ExitStack) -> DriverRig:
    """Build the rig; question i reads states and joints of an arm in a distinct pose."""
    cell = stack.enter_context(CellThread(FILE, devices=("abb", "abb-rws")))
    proxy = stack.enter_context(FaultProxy(cell.port("abb-rws"), device=cell.do))
    assert cell.cell is not None
    reader = WebReader(RwsAccess("127.0.0.1", proxy.port, cell.cell.rws.fingerprint))
    stack.callback(reader.session.close)

    def ask(i: int) -> float:
        cell.do("jog", joints_deg=goal(i))
        seen = reader.session.state()
        assert (seen.controller, seen.mode, seen.runs) == ("motoron", "auto", True)
        return math.dist(seen.joints_deg, goal(i))

    longest_s = 4 * 2 * HASTY_ABB.rws_s  # questions, each at most twice
    return DriverRig(reader, proxy, cell.do, ask, 1e-5, longest_s, PATIENT_ABB, HASTY_ABB)


ABB_RIGS: dict[str, Callable[[ExitStack], DriverRig]] = {
    "abb-calsrv": partial(abb_rig, stock=False),
    "abb-stock": partial(abb_rig, stock=True),
    "abb-rws": abb_rws_rig,
    "abb-simple-motion": partial(abb_simple_rig, proxied="abb-simple"),
    "abb-simple-state": partial(abb_simple_rig, proxied="abb-simple-state"),
}
