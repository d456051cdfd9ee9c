"""The C-Track driver on its simulated bridge.

Poses, reflectors, reference, odd poses, golden transcript.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from acquisition.cell import cell_from
from calib.text import read_toml
from drivers import ConfigError, CTrack, NotReady, PoseReading, TargetNotSeen
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.creaform.ctrack import quaternion
from mocks.shared.mbp import line
from mocks.world.transforms import turn
from tests.drivers.expected import Pair, converse, shapes
from tests.drivers.instrument_bench import CTRACK, FACING, ONE_SIDED
from tests.end_to_end.simulated import ROOT


@pytest.fixture(scope="module")
def shared() -> Iterator[CellThread]:
    with CellThread(ONE_SIDED, devices=("ctrack",)) as cell:
        assert cell.cell is not None
        cell.cell.arm.start(FACING, 1e6, 1e9)
        yield cell


@pytest.fixture
def meter(shared: CellThread) -> Iterator[CTrack]:
    shared.do("cover", body="T1", count=0)
    shared.do("cover", body="base", count=0)
    shared.do("ctrack", state="READY")
    meter = CTrack(shared.url("ctrack"), heartbeat_s=None)
    meter.connect()
    meter.arm()
    yield meter
    meter.disconnect()


def rotation(reading: PoseReading) -> np.ndarray:
    """The reading's quaternion as a matrix, by the rotation of three unit vectors."""
    w, v = reading.rot_wxyz[0], np.array(reading.rot_wxyz[1:])
    return np.array([e + 2 * w * np.cross(v, e) + 2 * np.cross(v, np.cross(v, e)) for e in np.eye(3)]).T


def missed(shared: CellThread, reading: PoseReading) -> tuple[float, float]:
    """Return the error of a pose against the truth: mm, mrad."""
    assert shared.cell is not None
    device = shared.cell.ctrack.device
    true = device.to_reference(device.frame(reading.target))
    angle = math.acos(min(1.0, (np.trace(rotation(reading).T @ true[:3, :3]) - 1.0) / 2.0))
    return math.dist(reading.xyz_mm, true[:3, 3]), 1000.0 * angle


def test_poses_of_tool_and_nests(shared: CellThread, meter: CTrack) -> None:
    assert meter.bodies == {"base": 24, "T1": 20, "T2": 9, "T3": 9, "N1": 9, "N2": 9, "N3": 9}
    for name in ("T1", "N1", "T2"):
        reading = meter.measure(name)
        miss_mm, miss_mrad = missed(shared, reading)
        assert miss_mm < 0.3
        assert miss_mrad < 0.5
        assert math.hypot(*reading.rot_wxyz) == pytest.approx(1.0, abs=1e-12)
        assert reading.rot_wxyz[0] >= 0.0
        assert (reading.visible_tool, reading.visible_base) == (20 if name == "T1" else 9, 24)


def test_moving_the_cameras_changes_nothing_in_the_reference(shared: CellThread, meter: CTrack) -> None:
    before = meter.measure("N2")
    shared.do("move_cameras", by_mm=[50.0, -80.0, 10.0])
    after = meter.measure("N2")
    shared.do("move_cameras", by_mm=[-50.0, 80.0, -10.0])
    assert math.dist(before.xyz_mm, after.xyz_mm) < 0.2


@pytest.mark.parametrize(
    ("body", "count", "seen"), [("T1", 16, True), ("T1", 17, False), ("base", 12, True), ("base", 13, False)]
)
def test_hidden_reflectors(shared: CellThread, meter: CTrack, body: str, count: int, seen: bool) -> None:
    shared.do("cover", body=body, count=count)
    if seen:
        assert meter.measure("T1").visible_tool == (4 if body == "T1" else 20)
        return
    with pytest.raises(TargetNotSeen) as caught:
        meter.measure("T1")
    assert (caught.value.code, caught.value.device) == (2002, "ctrack")
    assert caught.value.raw


def test_turned_away(shared: CellThread, meter: CTrack) -> None:
    assert shared.cell is not None
    shared.cell.arm.start((150.0, *FACING[1:]), 1e6, 1e9)
    with pytest.raises(TargetNotSeen):
        meter.measure("T1")
    shared.cell.arm.start(FACING, 1e6, 1e9)
    meter.measure("T1")


def test_bad_requests(shared: CellThread, meter: CTrack) -> None:
    with pytest.raises(ConfigError, match="T9"):
        meter.measure("T9")
    for options in ({"rate_hz": 0.0}, {"min_visible": 3}, {"min_visible": 9.5}, {"reference": "a b"}):
        with pytest.raises(ConfigError):
            CTrack("tcp://127.0.0.1:1", **options)  # type: ignore[arg-type]
    picky = CTrack(shared.url("ctrack"), heartbeat_s=None, min_visible_base=25)
    meter.disconnect()
    picky.connect()
    with pytest.raises(NotReady, match="24 targets"):
        picky.arm()
    picky.disconnect()


def test_a_cell_says_how_many_targets_must_be_visible(shared: CellThread, meter: CTrack) -> None:
    """Nubiola asks for 9, 20 and 12."""
    meter.disconnect()
    table = read_toml(ROOT / "examples" / "irb120_ctrack" / "cell.toml")[1]
    table["instrument"] |= {"min_visible": 9, "min_visible_base": 12}
    section = cell_from(table, "cell.toml").instrument
    strict = section.declared.make(shared.url("ctrack"), heartbeat_s=None, **section.options)
    assert isinstance(strict, CTrack)
    assert strict.least_on_reference == 12
    strict.connect()
    strict.arm()
    shared.do("cover", body="T1", count=11)
    assert strict.measure("T1").visible_tool == 9
    shared.do("cover", body="T1", count=12)
    with pytest.raises(TargetNotSeen):
        strict.measure("T1")
    strict.disconnect()
    table["instrument"]["min_visible"] = 3
    with pytest.raises(ConfigError, match="min_visible"):
        cell_from(table, "cell.toml")


def test_quaternion_of_every_turn() -> None:
    rng = np.random.default_rng(1)
    for vector in (*rng.uniform(-3.0, 3.0, size=(20, 3)), np.zeros(3), np.array([math.pi, 0.0, 0.0])):
        w, x, y, z = quaternion(turn(vector)[:3, :3])
        matrix = rotation(_with((w, x, y, z)))
        assert matrix == pytest.approx(turn(vector)[:3, :3], abs=1e-12)


def _with(q: tuple[float, float, float, float]) -> PoseReading:
    return PoseReading(
        "T1", (0, 0, 1), (0, 0, 0), 1, 0, 0, rot_wxyz=q, rot_std_mrad=0, visible_tool=9, visible_base=12
    )


# -- golden transcript ---------------------------------------------------------------------------------------

HELLO: list[Pair] = [
    (
        b"1 HELLO proto=1 client=truepose crc=1*05B0\n",
        line(
            "1 OK proto=1 kind=OCMM vendor=Creaform model=C-Track-780 serial=C780-001 fw=9.0 bridge=1.0 crc=1 "
            "units=mm,deg,C,hPa sim=1"
        ),
    ),
    (b"2 STATUS*B508\n", line("2 OK state=READY T=21.89")),
    (b"3 STATUS*F2DB\n", line("3 OK state=READY T=21.89")),
    (line("4 MODELS"), line("4 OK n=7 names=base,T1,T2,T3,N1,N2,N3 totals=24,9,9,9,9,9,9")),
    (line("5 DYNREF on=1 model=base"), line("5 OK")),
]
ASKED = line("6 MEASURE model=N1 ref=base frames=29 timeout=6.0 minvis=4")
POSE = line(
    "6 OK model=N1 ref=base x=-71.5 y=33.0 z=-80.0 q0=-0.6 q1=0.0 q2=0.8 q3=0.0 sx=0.03 sy=0.03 sz=0.03 srot=0.1 "
    "rms=0.02 visible=9 total=9 rvisible=24 rtotal=24 frames=29 t=12.5 age=0.0 temp=21.89"
)


def test_driver_speaks_as_written() -> None:
    reading = CTRACK.read([*HELLO, (ASKED, line("6 ACK eta=1.0") + POSE)], "N1", samples=29)
    assert reading.xyz_mm == (-71.5, 33.0, -80.0)
    assert reading.rot_wxyz == (0.6, 0.0, -0.8, 0.0)
    assert (reading.visible_tool, reading.visible_base, reading.t_s, reading.samples) == (9, 24, 12.5, 29)


def test_simulator_answers_as_written() -> None:
    with CellThread(CellFile(time_scale=10_000.0, effects=("none",)), devices=("ctrack",)) as cell:
        converse(cell.port("ctrack"), [*HELLO, (ASKED, line("6 ACK eta=1.0") + POSE)], same=shapes)
