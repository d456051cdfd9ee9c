"""Rigs of the Fanuc: MAPPDK, stock or custom server, Modbus in both layouts, RMI."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial

from drivers import FanucArm, FanucDeadlines, RobotArm, open_robot
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.faultproxy import FaultProxy
from service.conformance import DriverRig
from tests.conformance.truth import SCALE, sent_elsewhere

CELL = CellFile(robot="fanuc-lrmate200ic", time_scale=SCALE, effects=("none",))
PATIENT = FanucDeadlines(gap_s=0.001, move_margin_s=30.0, reply_s=30.0, settle_s=30.0)
HASTY = replace(
    PATIENT,
    move_margin_s=0.1,
    move_factor=0.0,
    reply_s=0.1,
    stop_s=0.1,
    settle_s=0.1,
    connect_s=0.1,
    takeover_s=0.1,
    abort_s=0.1,
)


def fanuc_rig(stack: ExitStack, *, device: str, options: str = "", stock: bool = True) -> DriverRig:
    """Build the rig of text or registers; with `stock`, the server is the one of text alone."""
    cell = stack.enter_context(CellThread(CELL, stock=stock, devices=("fanuc",)))
    proxy = stack.enter_context(FaultProxy(cell.port(device), device=cell.do))
    arm = FanucArm(f"tcp://127.0.0.1:{proxy.port}?logger={cell.port('fanuc-logger')}{options}")
    return _moves(stack, cell, proxy, arm)


def _moves(stack: ExitStack, cell: CellThread, proxy: FaultProxy, arm: RobotArm) -> DriverRig:
    """Return the rig whose question i goes to a distinct pose and reads it back."""
    stack.callback(arm.disconnect)
    goals: list[tuple[float, ...]] = []

    def ask(i: int) -> float:
        target = (10.0 + i % 70, 5.0 + i % 13, -(i % 29) - 1.0, i % 41 + 1.0, i % 17 + 1.0, -(i % 90) - 1.0)
        j1, j2, j3, j4, j5, j6 = target
        goals.append((j1, j2, -(j2 + j3), -j4, -j5, -j6))
        reached = arm.move_to(target).joints_deg
        read = arm.position().joints_deg
        assert cell.cell is not None
        truth = cell.cell.fanuc.controller.joints_deg()
        return max(math.dist(reached, target), math.dist(read, target), math.dist(read, truth))

    # 0.002 deg: two readings of a standing robot may differ by so much, in any number of joints.
    tolerance, longest_s = 0.002 * math.sqrt(6) + 0.0013, 6 * HASTY.reply_s
    elsewhere = partial(sent_elsewhere, cell, goals, 1e-4)
    return DriverRig(arm, proxy, cell.do, ask, tolerance, longest_s, PATIENT, HASTY, elsewhere)


def fanuc_state_rig(stack: ExitStack) -> DriverRig:
    """Questions to our server on the second port: is the pendant enabled? Every other time it is."""
    cell = stack.enter_context(CellThread(CELL, devices=("fanuc",)))
    proxy = stack.enter_context(FaultProxy(cell.port("fanuc-logger"), device=cell.do))
    arm = FanucArm(f"{cell.url('fanuc')}?logger={proxy.port}")
    stack.callback(arm.disconnect)

    def ask(i: int) -> float:
        mode = ("manual", "auto")[i % 2]
        cell.do("mode", mode=mode)
        try:
            status = arm.status()
        finally:
            cell.do("mode", mode="auto")
        right = (status.mode, status.motors_on, status.emergency_stop, status.moving) == (
            mode,
            True,
            False,
            False,
        )
        return 0.0 if right else math.inf

    return DriverRig(arm, proxy, cell.do, ask, 0.0, 3 * HASTY.reply_s, PATIENT, HASTY)


def rmi_rig(stack: ExitStack) -> DriverRig:
    """Build the rig of RMI, with the session behind the proxy."""
    cell = stack.enter_context(CellThread(CELL, devices=("fanuc-rmi",)))
    proxy = stack.enter_context(FaultProxy(cell.port("fanuc-rmi-session"), boundary=b"\n", device=cell.do))
    arm = open_robot("fanuc-rmi", f"{cell.url('fanuc-rmi')}?session={proxy.port}")
    return _moves(stack, cell, proxy, arm)


FANUC_RIGS: dict[str, Callable[[ExitStack], DriverRig]] = {
    "fanuc-mappdk": partial(fanuc_rig, device="fanuc"),
    "fanuc-mappdk-cal": fanuc_state_rig,
    "fanuc-mappdk-own": partial(fanuc_rig, device="fanuc", stock=False),
    "fanuc-modbus-hmi": partial(fanuc_rig, device="fanuc-modbus-hmi", options="&modbus=hmi"),
    "fanuc-modbus-io": partial(fanuc_rig, device="fanuc-modbus-io", options="&modbus=io"),
    "fanuc-rmi": rmi_rig,
}
