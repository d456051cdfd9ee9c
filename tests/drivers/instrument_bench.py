"""Every instrument driver on its simulator, with the properties that common tests need."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from drivers import BeamBroken, LengthMeter, PointMeter, PoseMeter, open_instrument
from mocks.cell import Cell, CellThread, make_world
from mocks.cell_file import CellFile
from mocks.leica.device import LeicaDevice
from mocks.world import ArmState
from tests.drivers.expected import ExpectedDevice, Pair

STILL = ArmState((0.0,) * 6, (0.0,) * 6, (1,) * 6)
PLACE = np.array(make_world(CellFile(effects=("none",))).true_point(STILL, "T1"))
BALLS = {  # 300 mm from T1 at rest, and too near, and too far
    "B1": tuple(map(float, PLACE + np.array([180.0, 0.0, -240.2]))),
    "B2": tuple(map(float, PLACE + np.array([0.0, 0.0, -298.5]))),
    "B3": tuple(map(float, PLACE + np.array([0.0, 301.5, 0.0]))),
}
# A target that looks one way, and the joints at which it looks at the instrument.
ONE_SIDED = CellFile(time_scale=10_000.0, effects=("none",), normals={"T1": (0.0, 0.0, 1.0)})
FACING = (-20.0, 0.0, 0.0, 0.0, 30.0, 0.0)


def truth(device: LeicaDevice, name: str) -> tuple[float, ...]:
    """Return the position of a target in the frame of the simulated tracker, mm."""
    return tuple(float(v) for v in device.to_tracker(device.true_world(name)))


@dataclass(frozen=True)
class Bench:
    """One driver, with its simulator and the properties that common tests need.

    `identity` holds maker, serial number, and whether the device is simulated (emScon does not state it). `busy`
    returns whether the simulator is in the middle of a reading. The order `odd` makes the next reading odd, `state`
    sets the state, and the order in `loss` voids a pending reading with the given error. If `pointed`, no name goes
    over the wire, and the beam is pointed at a place.
    """

    driver: str
    meter: type
    identity: tuple[str, str, bool | None]
    busy: Callable[[Cell], object]
    odd: str = "odd_reading"
    state: str = "tracker"
    loss: tuple[str, type[Exception]] | None = ("break_beam", BeamBroken)
    pointed: bool = False
    options: dict[str, Any] = field(default_factory=lambda: {"heartbeat_s": None})
    asked: dict[str, Any] = field(default_factory=dict)
    file: CellFile = field(default_factory=lambda: CellFile(effects=("none",)))

    def cell(self, time_scale: float) -> CellThread:
        """Return its simulator alone."""
        return CellThread(replace(self.file, time_scale=time_scale), devices=(self.driver,))

    def open(self, url: str, **options: Any) -> Any:
        """The driver at an address, not connected."""
        return open_instrument(self.driver, url, **self.options, **options)

    def armed(self, cell: CellThread) -> Any:
        """The driver on its simulator, connected and armed, its beam on T1 where it needs one."""
        meter = self.open(cell.url(self.driver))
        meter.connect()
        meter.arm()
        if self.pointed:
            assert cell.cell is not None
            meter.measure("T1", samples=1, near_mm=truth(cell.cell.at960, "T1"))
        return meter

    def measure(self, meter: Any, samples: int = 10) -> Any:
        """A reading of T1."""
        return meter.measure("T1", samples=samples, **self.asked)

    def read(self, pairs: Sequence[Pair], target: str, samples: int = 10) -> Any:
        """Read a target with the driver in a golden conversation."""
        with ExpectedDevice(pairs) as device:
            meter = self.open(f"tcp://127.0.0.1:{device.port}")
            try:
                meter.connect()
                meter.arm()
                return meter.measure(target, samples=samples, **self.asked)
            finally:
                meter.disconnect()


FARO = Bench("faro", PointMeter, ("FARO", "X01000500000", True), lambda cell: cell.faro.bridge.busy)
LEICA = Bench("leica", PointMeter, ("Leica", "750001", True), lambda cell: cell.leica.bridge.busy)
EMSCON = Bench(
    "emscon",
    PointMeter,
    ("Leica", "390123", None),
    lambda cell: cell.emscon.averaging,
    pointed=True,
    options={},
)
CTRACK = Bench(
    "ctrack",
    PoseMeter,
    ("Creaform", "C780-001", True),
    lambda cell: cell.ctrack.bridge.busy,
    odd="odd_pose",
    state="ctrack",
    loss=None,
)
QC20W = Bench(
    "qc20w",
    LengthMeter,
    ("Renishaw", "2Q0001", True),
    lambda cell: cell.qc20w.bridge.busy,
    odd="odd_length",
    loss=None,
    options={"heartbeat_s": None, "nominal_mm": 300.0},
    asked={"base_target": "B1"},
    file=CellFile(effects=("none",), nests=BALLS),
)
BENCHES = {bench.driver: bench for bench in (FARO, LEICA, EMSCON, CTRACK, QC20W)}
