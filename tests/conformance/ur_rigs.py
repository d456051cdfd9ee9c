"""Rigs of the UR driver: RTDE by proxy, real-time packet, primary interface, programs alone.

The real-time packet and the primary interface are used with their programs. The rigs of PolyScope X have neither a
dashboard nor port 30003.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial

from drivers import UrArm, UrDeadlines
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.faultproxy import FaultProxy
from service.conformance import DriverRig
from tests.conformance.truth import SCALE, sent_elsewhere

PATIENT_UR = UrDeadlines(
    connect_s=30.0, send_s=30.0, reply_s=30.0, start_s=30.0, settle_s=30.0, stop_s=30.0, move_margin_s=30.0
)
# A program that was lost does not begin; one whose answers are spoiled does, however busy the machine.
HASTY_REQUESTS = UrDeadlines(
    reply_s=0.3, start_s=0.3, stop_s=0.3, settle_s=0.3, move_factor=0.0, move_margin_s=0.3
)
HASTY_UR = replace(HASTY_REQUESTS, start_s=3.0)
TOLERANCE_DEG = 0.008  # read-back in steps of 1e-5 rad; a wrong bit below 1e-4 rad is believed


# Packages of 30003 and states of 30001 begin with their length; on 30004 a question may end without another to come.
BOUNDARIES = {"rtde": b"", "realtime": (1140).to_bytes(4), "primary": (378).to_bytes(4)}


def ur_rig(stack: ExitStack, proxied: str, feed: str, dialect: str = "polyscope-3.15") -> DriverRig:
    """Build the rig; question i goes to a distinct pose and reads it back.

    `proxied` is the port: `rtde`, `realtime` or `primary`.
    """
    robot = "ur5e" if dialect.startswith("polyscope-x") else "ur5"
    file = CellFile(robot=robot, time_scale=SCALE, effects=("none",), dialect=dialect)
    cell = stack.enter_context(CellThread(file, devices=("ur",)))
    device = "ur" if proxied == "rtde" else f"ur-{proxied}"
    proxy = stack.enter_context(FaultProxy(cell.port(device), boundary=BOUNDARIES[proxied], device=cell.do))
    ports = {name: cell.port(f"ur-{name}") for name in ("realtime", "secondary", "primary", "dashboard")}
    if proxied != "rtde":
        ports[proxied] = proxy.port
    options = "&".join(f"{name}={port}" for name, port in ports.items())
    arm = UrArm(
        f"tcp://127.0.0.1:{proxy.port if proxied == 'rtde' else cell.port('ur')}?feed={feed}&{options}"
    )
    stack.callback(arm.disconnect)
    goals: list[tuple[float, ...]] = []

    def ask(i: int) -> float:
        goal = (10.0 + i % 70, -5.0 - i % 13, i % 29 + 1.0, i % 41 + 1.0, i % 17 + 1.0, -(i % 90) - 1.0)
        goals.append(goal)
        reached = arm.move_to(goal).joints_deg
        read = arm.position().joints_deg
        assert cell.cell is not None
        truth = cell.cell.arm.joints_deg()
        return max(abs(a - b) for a, b in zip((*reached, *read, *read), (*goal, *goal, *truth), strict=True))

    longest_s = 2 * HASTY_UR.reply_s + 2 * HASTY_UR.stop_s + HASTY_UR.start_s + HASTY_UR.move_margin_s
    elsewhere = partial(sent_elsewhere, cell, goals, 1e-5)
    return DriverRig(
        arm, proxy, cell.do, ask, TOLERANCE_DEG, longest_s, PATIENT_UR, HASTY_UR, elsewhere, HASTY_REQUESTS
    )


UR_RIGS: dict[str, Callable[[ExitStack], DriverRig]] = {
    "ur-rtde": partial(ur_rig, proxied="rtde", feed="rtde"),
    "ur-realtime": partial(ur_rig, proxied="realtime", feed="realtime"),
    "ur-program": partial(ur_rig, proxied="realtime", feed="rtde"),
    "ur-primary": partial(ur_rig, proxied="primary", feed="primary", dialect="polyscope-x-primary"),
    "ur-x-rtde": partial(ur_rig, proxied="rtde", feed="rtde", dialect="polyscope-x"),
    "ur-x-program": partial(ur_rig, proxied="primary", feed="rtde", dialect="polyscope-x"),
}
