"""Every driver with its simulator and no proxy between, ready to be read.

The benchmark of the overhead and wire logs use them.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

from drivers import (
    AbbArm,
    AbbSimpleArm,
    CTrack,
    EmsconTracker,
    FanucArm,
    FanucDeadlines,
    FaroTracker,
    LeicaTracker,
    Qc20w,
    RobotArm,
    UrArm,
    WireSink,
    YaskawaArm,
    YaskawaDeadlines,
    open_robot,
)
from mocks.cell import CellThread, make_world
from mocks.cell_file import CellFile
from mocks.world import ArmState
from mocks.yaskawa.controller import MAX_DEG_S, PULSES_PER_DEG

SCALE = 10_000.0
PLAIN = CellFile(time_scale=SCALE, effects=("none",))


@dataclass(frozen=True)
class Bench:
    """Connected driver.

    `read` requests one reading. `arm` is the same driver if it is that of a robot.
    """

    read: Callable[[], object]
    arm: RobotArm | None = None


Setup = Callable[[ExitStack, WireSink | None], Bench]


def robot(
    make: Callable[..., RobotArm], device: str, file: CellFile, options: str = "", *, stock: bool = False
) -> Setup:
    """Return a setup that reads the joints.

    `options` belong to the address and contain the ports of the cell by name.
    """

    def setup(stack: ExitStack, wire: WireSink | None) -> Bench:
        cell = stack.enter_context(CellThread(file, stock=stock, devices=(device.split("-modbus")[0],)))
        arm = make(cell.url(device) + options.format_map(_Ports(cell)), wire=wire)
        stack.callback(arm.disconnect)
        arm.connect()
        return Bench(arm.position, arm)

    return setup


class _Ports(dict[str, int]):
    """`{ur_realtime}` in a format is the port of device `ur-realtime`."""

    def __init__(self, cell: CellThread) -> None:
        super().__init__()
        self._cell = cell

    def __missing__(self, name: str) -> int:
        return self._cell.port(name.replace("_", "-"))


def meter(make: Callable[..., Any], device: str, **options: Any) -> Setup:
    """Measures one target, ten samples."""

    def setup(stack: ExitStack, wire: WireSink | None) -> Bench:
        cell = stack.enter_context(CellThread(PLAIN, devices=(device,)))
        instrument = make(cell.url(device), wire=wire, **options)
        stack.callback(instrument.disconnect)
        instrument.connect()
        instrument.arm()
        if device == "emscon":  # names mean nothing to it: the beam has to hold something
            assert cell.cell is not None
            tracker = cell.cell.at960
            instrument.measure("T1", samples=10, near_mm=tracker.to_tracker(tracker.true_world("T1")))
        return Bench(lambda: instrument.measure("T1", samples=10))

    return setup


def ballbar(device: str) -> Setup:
    """Reads the length to a ball that is 300 mm from the one on the tool."""

    def setup(stack: ExitStack, wire: WireSink | None) -> Bench:
        x, y, z = map(float, make_world(PLAIN).true_point(ArmState((0.0,) * 6, (0.0,) * 6, (1,) * 6), "T1"))
        file = CellFile(time_scale=SCALE, effects=("none",), nests={"B1": (x, y, z - 300.0)})
        cell = stack.enter_context(CellThread(file, devices=(device,)))
        url = str(cell.endpoints[0].line()["url"]) if device == "qc20w-serial" else cell.url(device)
        bar = Qc20w(url, nominal_mm=300.0, heartbeat_s=None, wire=wire)
        stack.callback(bar.disconnect)
        bar.connect()
        bar.arm()
        return Bench(lambda: bar.measure("T1", base_target="B1", samples=10))

    return setup


QUICK = FanucDeadlines(gap_s=0.001)


def _quick_fanuc(url: str, wire: WireSink | None) -> FanucArm:
    return FanucArm(url, wire=wire, deadlines=QUICK)


def _quick_yaskawa(url: str, wire: WireSink | None) -> YaskawaArm:
    return YaskawaArm(
        url,
        pulses_per_deg=PULSES_PER_DEG,
        max_deg_s=MAX_DEG_S,
        wire=wire,
        deadlines=YaskawaDeadlines(gap_s=0.001),
    )


FANUC = CellFile(robot="fanuc-lrmate200ic", time_scale=SCALE, effects=("none",))
UR = CellFile(robot="ur5", time_scale=SCALE, effects=("none",))
YASKAWA = CellFile(robot="yaskawa-gp7", time_scale=SCALE, effects=("none",))
UR_PORTS = "&realtime={ur_realtime}&secondary={ur_secondary}&dashboard={ur_dashboard}"

READINGS: dict[str, Setup] = {
    "abb, open_abb": robot(AbbArm, "abb", PLAIN, "?background={abb_background}", stock=True),
    "abb, CALSRV": robot(AbbArm, "abb", PLAIN, "?background={abb_background}"),
    "abb, simple_message": robot(AbbSimpleArm, "abb-simple", PLAIN, "?state={abb_simple_state}"),
    "fanuc, MAPPDK": robot(_quick_fanuc, "fanuc", FANUC, "?logger={fanuc_logger}", stock=True),
    "fanuc, MAPPDK with CALSRV": robot(_quick_fanuc, "fanuc", FANUC, "?logger={fanuc_logger}"),
    "fanuc, Modbus hmi": robot(_quick_fanuc, "fanuc-modbus-hmi", FANUC, "?modbus=hmi"),
    "fanuc, Modbus io": robot(_quick_fanuc, "fanuc-modbus-io", FANUC, "?modbus=io"),
    "fanuc, RMI": robot(partial(open_robot, "fanuc-rmi", deadlines=QUICK), "fanuc-rmi", FANUC),
    "ur, RTDE": robot(UrArm, "ur", UR, "?feed=rtde" + UR_PORTS),
    "ur, 30003": robot(UrArm, "ur", UR, "?feed=realtime" + UR_PORTS),
    "yaskawa, HSES": robot(_quick_yaskawa, "yaskawa", YASKAWA),
    "faro, MBP/1": meter(FaroTracker, "faro", heartbeat_s=None),
    "leica, MBP/1": meter(LeicaTracker, "leica", heartbeat_s=None),
    "leica, emScon": meter(EmsconTracker, "emscon"),
    "ctrack, MBP/1": meter(CTrack, "ctrack", heartbeat_s=None),
    "qc20w, MBP/1": ballbar("qc20w"),
    "qc20w, serial": ballbar("qc20w-serial"),
}
