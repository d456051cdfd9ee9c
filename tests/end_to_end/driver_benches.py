"""Every driver with its simulator, and deadlines that a simulator keeps on a busy machine."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from drivers import (
    AbbArm,
    AbbDeadlines,
    AbbSimpleArm,
    AcquisitionError,
    CTrack,
    EmsconTracker,
    FanucArm,
    FanucDeadlines,
    FaroTracker,
    InstrumentDeadlines,
    LeicaTracker,
    Qc20w,
    RobotArm,
    UrArm,
    UrDeadlines,
    YaskawaArm,
    YaskawaDeadlines,
    open_robot,
)
from mocks.cell import CellThread, make_world
from mocks.cell_file import CellFile
from mocks.world import ArmState
from mocks.yaskawa.controller import MAX_DEG_S, PULSES_PER_DEG

FAST = CellFile(time_scale=10_000.0, effects=("none",))
STILL = ArmState((0.0,) * 6, (0.0,) * 6, (1,) * 6)
BAR_MM = 300.0
PATIENT_S = 2.0  # waited for in full by the few tests of a device that says nothing


def balls() -> dict[str, tuple[float, ...]]:
    """B1 lies 300 mm from T1 of the arm at rest, B2 too near for that bar."""
    x, y, z = make_world(FAST).true_point(STILL, "T1")
    return {"B1": (x, y, z - BAR_MM), "B2": (x, y, z - BAR_MM + 1.5), "B3": (x + 600.0, y, z)}


BRIDGE: dict[str, Any] = {
    "heartbeat_s": None,
    "deadlines": InstrumentDeadlines(connect_s=PATIENT_S, reply_s=PATIENT_S, takeover_s=0.1),
}


@dataclass(frozen=True)
class Bench:
    """One driver before its own simulator."""

    simulator: str
    endpoint: str
    make: Callable[[str], Any]
    file: CellFile = FAST
    stock: bool = False

    def cell(self) -> CellThread:
        return CellThread(self.file, stock=self.stock, devices=(self.simulator,))


def abb_arm(url: str) -> AbbArm:
    return AbbArm(
        url,
        deadlines=AbbDeadlines(
            connect_s=PATIENT_S,
            ping_s=1.0,
            reply_s=PATIENT_S,
            stop_s=PATIENT_S,
            move_margin_s=PATIENT_S,
        ),
    )


FANUC = FanucDeadlines(
    connect_s=PATIENT_S, reply_s=PATIENT_S, still_s=0.3, move_margin_s=PATIENT_S, gap_s=0.001
)


def fanuc_arm(url: str) -> FanucArm:
    return FanucArm(url, deadlines=FANUC)


def rmi_arm(url: str) -> RobotArm:
    return open_robot("fanuc-rmi", url, deadlines=FANUC)


def ur_arm(url: str) -> UrArm:
    return UrArm(
        url,
        deadlines=UrDeadlines(
            connect_s=PATIENT_S, reply_s=PATIENT_S, start_s=PATIENT_S, move_margin_s=PATIENT_S
        ),
    )


def yaskawa_arm(url: str) -> YaskawaArm:
    return YaskawaArm(
        url.replace("tcp:", "udp:"),
        pulses_per_deg=PULSES_PER_DEG,
        max_deg_s=MAX_DEG_S,
        deadlines=YaskawaDeadlines(reply_s=PATIENT_S, gap_s=0.001),
    )


LRMATE, UR5 = replace(FAST, robot="fanuc-lrmate200ic"), replace(FAST, robot="ur5")
BENCHES = {
    "abb": Bench("abb", "abb", abb_arm),
    "abb-stock": Bench("abb", "abb", abb_arm, stock=True),
    "abb-simple": Bench("abb-simple", "abb-simple", AbbSimpleArm),
    "fanuc": Bench("fanuc", "fanuc", fanuc_arm, LRMATE),
    "fanuc-stock": Bench("fanuc", "fanuc", fanuc_arm, LRMATE, stock=True),
    "fanuc-io": Bench("fanuc", "fanuc-modbus-io", lambda url: fanuc_arm(f"{url}?modbus=io"), LRMATE),
    "fanuc-hmi": Bench("fanuc", "fanuc-modbus-hmi", lambda url: fanuc_arm(f"{url}?modbus=hmi"), LRMATE),
    "fanuc-rmi": Bench("fanuc-rmi", "fanuc-rmi", rmi_arm, LRMATE),
    "ur": Bench("ur", "ur", ur_arm, UR5),
    "yaskawa": Bench("yaskawa", "yaskawa", yaskawa_arm, replace(FAST, robot="yaskawa-gp7")),
    "faro": Bench("faro", "faro", lambda url: FaroTracker(url, **BRIDGE)),
    "leica": Bench("leica", "leica", lambda url: LeicaTracker(url, **BRIDGE)),
    "leica-30mm": Bench("leica", "leica", lambda url: LeicaTracker(url, reflector_mm=30.0, **BRIDGE)),
    "emscon": Bench(
        "emscon",
        "emscon",
        lambda url: EmsconTracker(
            url, deadlines=InstrumentDeadlines(connect_s=PATIENT_S, reply_s=PATIENT_S, takeover_s=0.1)
        ),
    ),
    "emscon-9in": Bench("emscon", "emscon", lambda url: EmsconTracker(url, reflector="CCR-9in")),
    "ctrack": Bench("ctrack", "ctrack", lambda url: CTrack(url, **BRIDGE)),
    "qc20w": Bench(
        "qc20w",
        "qc20w",
        lambda url: Qc20w(url, nominal_mm=BAR_MM, **BRIDGE),
        replace(FAST, nests=balls()),
    ),
}
INSTRUMENTS = ("faro", "leica", "emscon", "ctrack", "qc20w")


def sentence(error: AcquisitionError) -> bool:
    """Begins and ends like one, and is long enough to say something."""
    return re.fullmatch(r"[A-Z].{20,}\.", error.what_to_do) is not None
