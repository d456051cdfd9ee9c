"""Bad devices, one by one, through the drivers: each has its error class, its stable code, its device and its advice.

The list is that of what goes wrong on a bench before anything has been measured: wrong address, wrong device or
version behind it, another robot or another maker than the cell file names, manual mode, emergency stop, no weather
station, wrong reflector, wrong extension bar, points at zero, NaN.
"""

from __future__ import annotations

import math
import re
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from acquisition.cell import Cell, cell_from
from acquisition.identity import OtherDevice, check_identity, is_model
from drivers import (
    AbbArm,
    AbbDeadlines,
    AbbSimpleArm,
    AcquisitionError,
    Busy,
    CommandRefused,
    ConfigError,
    CTrack,
    EmergencyStop,
    EmsconDeadlines,
    EmsconTracker,
    FanucArm,
    FanucDeadlines,
    FaroTracker,
    Identity,
    JointLimit,
    LeicaTracker,
    LinkError,
    LinkLost,
    LinkTimeout,
    MbpDeadlines,
    NotReady,
    OutOfRange,
    ProtectiveStop,
    ProtocolError,
    Qc20w,
    UrArm,
    UrDeadlines,
    WrongMode,
)
from mocks.cell import CellThread, make_world
from mocks.cell_file import CellFile
from mocks.mbp import line
from mocks.world import ArmState
from tests.drivers.expected import CALSRV_MAIN, MBP_MEASURE, ExpectedDevice

FAST = CellFile(time_scale=10_000.0, effects=("none",))
STILL = ArmState((0.0,) * 6, (0.0,) * 6, (1,) * 6)
BAR_MM = 300.0


def balls() -> dict[str, tuple[float, ...]]:
    """B1 lies 300 mm from T1 of the arm at rest, B2 too near for that bar."""
    x, y, z = make_world(FAST).true_point(STILL, "T1")
    return {"B1": (x, y, z - BAR_MM), "B2": (x, y, z - BAR_MM + 1.5), "B3": (x + 600.0, y, z)}


BRIDGE: dict[str, Any] = {
    "heartbeat_s": None,
    "deadlines": MbpDeadlines(connect_s=1.0, reply_s=0.5, takeover_s=0.1),
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


def _abb(url: str) -> AbbArm:
    return AbbArm(
        url, deadlines=AbbDeadlines(connect_s=1.0, ping_s=0.5, reply_s=0.5, stop_s=0.5, move_margin_s=0.5)
    )


def _fanuc(url: str) -> FanucArm:
    return FanucArm(
        url, deadlines=FanucDeadlines(connect_s=1.0, reply_s=0.5, still_s=0.3, move_margin_s=0.5, gap_s=0.001)
    )


def _ur(url: str) -> UrArm:
    return UrArm(url, deadlines=UrDeadlines(connect_s=1.0, reply_s=0.5, start_s=0.5, move_margin_s=0.5))


LRMATE, UR5 = replace(FAST, robot="fanuc-lrmate200ic"), replace(FAST, robot="ur5")
BENCHES = {
    "abb": Bench("abb", "abb", _abb),
    "abb-stock": Bench("abb", "abb", _abb, stock=True),
    "abb-simple": Bench("abb-simple", "abb-simple", AbbSimpleArm),
    "fanuc": Bench("fanuc", "fanuc", _fanuc, LRMATE),
    "fanuc-stock": Bench("fanuc", "fanuc", _fanuc, LRMATE, stock=True),
    "fanuc-io": Bench("fanuc", "fanuc-modbus-io", lambda url: _fanuc(f"{url}?modbus=io"), LRMATE),
    "fanuc-hmi": Bench("fanuc", "fanuc-modbus-hmi", lambda url: _fanuc(f"{url}?modbus=hmi"), LRMATE),
    "ur": Bench("ur", "ur", _ur, UR5),
    "faro": Bench("faro", "faro", lambda url: FaroTracker(url, **BRIDGE)),
    "leica": Bench("leica", "leica", lambda url: LeicaTracker(url, **BRIDGE)),
    "leica-30mm": Bench("leica", "leica", lambda url: LeicaTracker(url, reflector_mm=30.0, **BRIDGE)),
    "emscon": Bench(
        "emscon",
        "emscon",
        lambda url: EmsconTracker(url, deadlines=EmsconDeadlines(connect_s=1.0, reply_s=0.5, takeover_s=0.1)),
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

# -- what is tried -------------------------------------------------------------------------------------------

Act = Callable[[CellThread, Any], object]


def arm(cell: CellThread, device: Any) -> None:
    device.connect()
    device.arm()


def move(*joints_deg: float) -> Act:
    """A move, when it is too late to refuse the arming."""
    return lambda cell, device: (arm(cell, device), device.move_to(joints_deg))


def first(order: str, then: Act, **fields: object) -> Act:
    """An order of the back door, then the rest."""

    def act(cell: CellThread, device: Any) -> None:
        cell.do(order, **fields)
        then(cell, device)

    return act


def armed_then(order: str, then: Act, **fields: object) -> Act:
    """Arm, an order of the back door, then the rest."""

    def act(cell: CellThread, device: Any) -> None:
        arm(cell, device)
        cell.do(order, **fields)
        then(cell, device)

    return act


def measure(cell: CellThread, device: Any) -> None:
    """A nest, by name; emScon points at it first."""
    near = None
    if isinstance(device, EmsconTracker):
        assert cell.cell is not None
        tracker = cell.cell.at960
        near = [float(value) for value in tracker.to_tracker(tracker.true_world("N1"))]
    device.measure("N1", samples=5, near_mm=near)


def length(base: str) -> Act:
    return lambda cell, device: device.measure("T1", base_target=base, samples=5)


def second_client(bench: str) -> Act:
    def act(cell: CellThread, device: Any) -> None:
        other = BENCHES[bench].make(cell.url(BENCHES[bench].endpoint))
        try:
            arm(cell, other)
            device.connect()
        finally:
            other.disconnect()

    return act


HERE = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
ZEROS = {"x": 0.0, "y": 0.0, "z": 0.0, "r": 0.0}
NAN = {"x": math.nan}


@dataclass(frozen=True)
class Case:
    """`says` and `do`: what message and advice must contain, as regular expressions."""

    what: str
    bench: str
    act: Act
    kind: type[AcquisitionError]
    code: int
    says: str
    do: str


CASES = [
    # controller in manual mode
    Case("manual mode", "abb", first("mode", arm, mode="manual"), WrongMode, 3004, "manual", "automatic"),
    Case(
        "manual mode", "abb-simple", first("mode", arm, mode="manual"), WrongMode, 3004, "manual", "automatic"
    ),
    Case(
        "manual mode, not told before a move",
        "abb-stock",
        first("mode", move(*HERE), mode="manual"),
        ProtectiveStop,
        4002,
        "stopped on the way",
        "reset it at the controller",
    ),
    Case("manual mode", "fanuc", first("mode", arm, mode="manual"), WrongMode, 3004, "pendant", "automatic"),
    Case(
        "manual mode",
        "fanuc-io",
        first("mode", arm, mode="manual"),
        WrongMode,
        3004,
        "power off",
        "automatic",
    ),
    Case(
        "manual mode, not told before a move",
        "ur",
        first("mode", move(1.0, -20.0, 1.0, 1.0, 1.0, 1.0), mode="manual"),
        WrongMode,
        3004,
        "did not begin",
        "remote control",
    ),
    Case("motors off", "abb", first("motors", arm, on=False), WrongMode, 3004, "motors off", "motors on"),
    Case(
        "motors off", "fanuc", first("motors", arm, on=False), WrongMode, 3004, "servo power off", "motors on"
    ),
    Case("motors off", "ur", first("motors", arm, on=False), WrongMode, 3004, "idle", "release its brakes"),
    # emergency stop, protective stop
    *(
        Case(
            "emergency stop",
            bench,
            first("estop", arm),
            EmergencyStop,
            4001,
            "emergency stop pressed",
            "reset it",
        )
        for bench in ("abb", "abb-simple", "fanuc", "fanuc-io", "fanuc-hmi", "ur")
    ),
    Case(
        "emergency stop, not told before a move",
        "fanuc-stock",
        first("estop", move(*HERE)),
        ProtectiveStop,
        4002,
        "emergency stop",
        "reset it",
    ),
    Case(
        "emergency stop, of a program that only falls silent",
        "abb-stock",
        first("estop", arm),
        LinkTimeout,
        1001,
        "ping_s",
        "emergency stop",
    ),
    Case(
        "protective stop", "ur", first("supervise", arm), ProtectiveStop, 4002, "protective stop", "reset it"
    ),
    # no weather station, not ready
    Case("no weather", "faro", first("weather", arm, on=False), NotReady, 3005, "weather", "weather station"),
    Case(
        "no weather", "leica", first("weather", arm, on=False), NotReady, 3005, "weather", "weather station"
    ),
    Case(
        "no weather", "emscon", first("weather", arm, on=False), NotReady, 3005, "weather", "weather station"
    ),
    Case("warming up", "faro", first("tracker", arm, state="WARMING"), NotReady, 3005, "WARMING", "start-up"),
    Case(
        "warming up", "ctrack", first("ctrack", arm, state="WARMING"), NotReady, 3005, "WARMING", "start-up"
    ),
    *(
        Case(
            "emergency stop", bench, first(order, arm, state="ESTOP"), EmergencyStop, 4001, "stop", "reset it"
        )
        for bench, order in (("faro", "tracker"), ("leica", "tracker"), ("ctrack", "ctrack"))
    ),
    Case(
        "an alarm stands", "fanuc", first("supervise", arm), ProtectiveStop, 4002, "alarm 11-050", "reset it"
    ),
    # wrong reflector, wrong bar
    Case("wrong SMR", "leica-30mm", arm, CommandRefused, 3009, "no reflector of 30 mm", "right SMR"),
    Case("wrong SMR", "emscon-9in", arm, ConfigError, 6000, "no reflector 'CCR-9in'", "cell"),
    Case(
        "wrong extension bar",
        "qc20w",
        first("extend", arm, nominal_mm=150.0),
        NotReady,
        3005,
        "150.* mm, the cell needs 300 mm",
        "right extension bar",
    ),
    Case(
        "bar between other balls",
        "qc20w",
        lambda cell, device: (arm(cell, device), length("B2")(cell, device)),
        OutOfRange,
        2003,
        "out of stroke",
        "right extension bar",
    ),
    # points at zero, NaN
    *(
        Case(
            f"{what} as a reading",
            bench,
            armed_then(order, measure, fields=fields),
            ProtocolError,
            1003,
            says,
            "cannot be a measurement",
        )
        for bench, order in (
            ("faro", "odd_reading"),
            ("leica", "odd_reading"),
            ("emscon", "odd_reading"),
            ("ctrack", "odd_pose"),
        )
        for what, fields, says in (
            ("0, 0, 0", ZEROS, "at the origin"),
            ("NaN", NAN, "nan|a number that is none"),
        )
    ),
    Case(
        "NaN as a reading",
        "qc20w",
        armed_then("odd_length", length("B1"), fields={"d": math.nan}),
        ProtocolError,
        1003,
        "d=nan",
        "cannot be a measurement",
    ),
    *(
        Case(
            "NaN as a target",
            bench,
            move(*[math.nan] * 6),
            JointLimit,
            3003,
            "joint 1 to nan",
            "Remove this pose",
        )
        for bench in ("abb", "abb-stock", "abb-simple", "fanuc", "fanuc-io", "fanuc-hmi", "ur")
    ),
    # another client has it
    *(
        Case(
            "another client",
            bench,
            second_client(bench),
            Busy,
            3002,
            "in use|10011",
            "Close the other program",
        )
        for bench in INSTRUMENTS
    ),
]


def sentence(error: AcquisitionError) -> bool:
    """Begins and ends like one, and is long enough to say something."""
    return re.fullmatch(r"[A-Z].{20,}\.", error.what_to_do) is not None


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.bench}: {case.what}")
def test_each_has_its_class_code_device_and_advice(case: Case) -> None:
    bench = BENCHES[case.bench]
    with bench.cell() as cell:
        device = bench.make(cell.url(bench.endpoint))
        try:
            with pytest.raises(AcquisitionError) as caught:
                case.act(cell, device)
        finally:
            device.disconnect()
    error = caught.value
    assert (type(error), error.code, error.device) == (case.kind, case.code, device.name)
    assert re.search(case.says, error.message), error.message
    assert sentence(error), error.what_to_do
    assert re.search(case.do, error.what_to_do), error.what_to_do


# -- addresses -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bench", BENCHES)
def test_nobody_at_the_address(bench: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    device = BENCHES[bench].make(f"tcp://127.0.0.1:{port}")
    with pytest.raises(LinkLost) as caught:
        device.connect()
    assert caught.value.code == 1002
    assert caught.value.device.startswith(device.name)  # a second connection has a name of its own behind it
    assert "127.0.0.1" in caught.value.message
    assert "network address" in caught.value.what_to_do


@pytest.mark.parametrize(
    ("make", "kind", "says"),
    [
        (lambda: _abb("tcp://no-such-host.invalid:5000").connect(), LinkLost, "no-such-host.invalid:5000"),
        (
            lambda: Qc20w("/dev/no-such-port", nominal_mm=BAR_MM, **BRIDGE).connect(),
            LinkLost,
            "/dev/no-such-port",
        ),
        (lambda: _ur("tcp://192.168.1.10"), ConfigError, "has no port"),
        (lambda: _fanuc("192.168.1.10:18735"), ConfigError, "must begin with tcp://"),
    ],
)
def test_no_such_host_port_or_form(
    make: Callable[[], object], kind: type[AcquisitionError], says: str
) -> None:
    with pytest.raises(kind, match=says) as caught:
        make()
    assert sentence(caught.value)


OWN = {
    "abb": {"abb"},
    "abb-simple": {"abb-simple"},
    "fanuc": {"fanuc"},
    "fanuc-hmi": {
        "fanuc-modbus-hmi",
        "fanuc-modbus-io",
    },  # one protocol; what the registers mean is not in it
    "ur": {"ur"},
    "faro": {"faro"},
    "leica": {"leica"},
    "emscon": {"emscon"},
    "ctrack": {"ctrack"},
    "qc20w": {"qc20w"},
}


@pytest.fixture(scope="module")
def everything() -> Any:
    simulators = ("abb", "abb-simple", "fanuc", "ur", "faro", "leica", "emscon", "ctrack", "qc20w")
    with CellThread(FAST, devices=simulators) as cell:
        yield cell


@pytest.mark.parametrize("bench", OWN)
def test_every_other_device_on_the_port_is_refused(everything: CellThread, bench: str) -> None:
    """The bridge of another maker's tracker speaks the same lines: that one, its identity gives away."""
    others = [end.device for end in everything.endpoints if end.device not in OWN[bench]]

    def met(endpoint: str) -> AcquisitionError | None:
        device = BENCHES[bench].make(everything.url(endpoint))
        try:
            device.connect()
            check_identity(cell_of(instrument=bench), "instrument", device.identify())
        except AcquisitionError as error:
            return error
        finally:
            device.disconnect()
        return None

    with ThreadPoolExecutor(max_workers=len(others)) as pool:
        errors = dict(zip(others, pool.map(met, others), strict=True))
    for endpoint, error in errors.items():
        assert isinstance(error, LinkError | OtherDevice), (endpoint, error)
        assert error.code in (1001, 1002, 1003, 6102)
        assert sentence(error)
        assert re.search("address|program runs|programs run|model, driver or url", error.what_to_do), endpoint
    makers = {name for name, error in errors.items() if isinstance(error, OtherDevice)}
    assert makers == {"faro": {"leica"}, "leica": {"faro"}}.get(bench, set())


# -- versions ------------------------------------------------------------------------------------------------


def test_bridge_of_another_version() -> None:
    request, reply = MBP_MEASURE[0]
    changed = line(reply.rsplit(b"*", 1)[0].decode().replace("proto=1", "proto=2"))
    with ExpectedDevice([(request, changed)]) as device:
        tracker = FaroTracker(f"tcp://127.0.0.1:{device.port}", **BRIDGE)
        with pytest.raises(ProtocolError, match="proto is 2, needed 1") as caught:
            tracker.connect()
    assert (caught.value.code, caught.value.device) == (1003, "faro")
    assert "versions of MBP" in caught.value.what_to_do


def test_bridge_that_refuses_our_version() -> None:
    refusal = line('1 ERR code=103 text="proto=2 only" retry=0')
    with ExpectedDevice([(MBP_MEASURE[0][0], refusal)]) as device:
        tracker = FaroTracker(f"tcp://127.0.0.1:{device.port}", **BRIDGE)
        with pytest.raises(ProtocolError, match="proto=2 only") as caught:
            tracker.connect()
    assert (caught.value.code, caught.value.device) == (1003, "faro")
    assert "versions of MBP" in caught.value.what_to_do


def test_robot_program_of_another_version() -> None:
    main = [CALSRV_MAIN[0], (b"200 #", b"200 1 CAL 2 5 #\n")]
    with ExpectedDevice(main) as device:
        robot = _abb(f"tcp://127.0.0.1:{device.port}")
        with pytest.raises(ProtocolError, match="another version") as caught:
            robot.connect()
    assert (caught.value.code, caught.value.device) == (1003, "abb")
    assert "program version" in caught.value.what_to_do


def test_controller_of_another_version() -> None:
    with ExpectedDevice([(b"\x00\x05V\x00\x02", b"\x00\x04V\x00")]) as device:
        robot = _ur(f"tcp://127.0.0.1:{device.port}")
        with pytest.raises(ProtocolError, match="version 2") as caught:
            robot.connect()
    assert (caught.value.code, caught.value.device) == (1003, "ur")
    assert "program version" in caught.value.what_to_do


# -- another robot than the cell file says -------------------------------------------------------------------


def cell_of(*, model: str = "abb-irb120", instrument: str = "faro") -> Cell:
    robot = {"model": model, "driver": "abb", "url": "tcp://127.0.0.1:1"}
    meter: dict[str, Any] = {"driver": instrument, "url": "tcp://127.0.0.1:2"}
    meter |= {"nominal_mm": BAR_MM} if instrument == "qc20w" else {"station_mm": [2400.0, -900.0, 350.0]}
    return cell_from(
        {
            "format": "truepose-cell/1",
            "name": "bench",
            "robot": robot,
            "instrument": meter,
            "world": {"nests": {"N1": [0, 0, 0], "N2": [600, 0, 0], "N3": [0, 600, 0]}},
            "tool": {"targets": {"T1": [0, 0, 125]}},
        },
        str(Path("bench.toml")),
    )


MODELS = {"abb": "abb-irb120", "fanuc": "fanuc-lrmate200ic", "ur": "ur5"}


@pytest.mark.parametrize("bench", MODELS)
def test_another_robot_than_the_cell_file_says(bench: str) -> None:
    with BENCHES[bench].cell() as cell:
        robot = BENCHES[bench].make(cell.url(BENCHES[bench].endpoint))
        robot.connect()
        who = robot.identify()
        robot.disconnect()
    check_identity(cell_of(model=MODELS[bench]), "robot", who)
    for other in {*MODELS.values(), "ur10"} - {MODELS[bench]}:
        with pytest.raises(OtherDevice) as caught:
            check_identity(cell_of(model=other), "robot", who)
        assert (caught.value.code, caught.value.exit_code, caught.value.device) == (6102, 2, "robot")
        assert other in caught.value.message
        assert "cell file" in caught.value.what_to_do


@pytest.mark.parametrize(
    ("name", "maker", "told", "same"),
    [
        ("abb-irb120", "ABB", "IRB 120-3/0.6", True),
        ("abb-irb120", "ABB", "IRB120", True),
        ("abb-irb120", "ABB", "IRB 1200-5/0.9", False),
        ("abb-irb120", "ABB", "IRB 1520", False),
        ("fanuc-lrmate200ic", "FANUC", "LR Mate 200iC", True),
        ("fanuc-lrmate200ic", "FANUC", "LR Mate 200iD", False),
        ("ur5", "Universal Robots", "UR5", True),
        ("ur5", "Universal Robots", "UR5e", False),
        ("ur10", "Universal Robots", "UR5", False),
    ],
)
def test_how_makers_write_their_models(name: str, maker: str, told: str, same: bool) -> None:
    assert is_model(name, maker, told) is same


def test_silence_about_the_model_proves_nothing() -> None:
    check_identity(cell_of(model="fanuc-lrmate200ic"), "robot", Identity("Fanuc", "", "", "", "mappdk"))
    check_identity(cell_of(), "instrument", Identity("Example", "Still", "0", "0", "mbp1"))
    with pytest.raises(OtherDevice, match="Leica"):
        check_identity(cell_of(), "instrument", Identity("Leica Geosystems", "AT960", "1", "1", "mbp1"))
