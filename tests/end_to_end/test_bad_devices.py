"""Bad devices, one by one, through the drivers.

Each has its error class, its stable code, its device and its advice. The list has the faults of a bench before the
first measurement: manual mode, emergency stop, no weather station, wrong reflector, wrong extension bar, points at
zero, NaN. `test_other_devices.py` has wrong addresses, and other devices than in the cell file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from drivers import (
    AcquisitionError,
    Busy,
    CommandRefused,
    ConfigError,
    EmergencyStop,
    EmsconTracker,
    JointLimit,
    LinkTimeout,
    NotReady,
    OutOfRange,
    ProtectiveStop,
    ProtocolError,
    WrongMode,
)
from mocks.cell import CellThread
from tests.end_to_end.driver_benches import (
    BENCHES,
    INSTRUMENTS,
    sentence,
)

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
    """Fault of a device with the expected error.

    `says` and `do` are regular expressions that the message and the advice must match.
    """

    what: str
    bench: str
    act: Act
    kind: type[AcquisitionError]
    code: int
    says: str
    do: str


CASES = [
    # controller in manual mode
    Case(
        "manual mode", "abb", first("mode", arm, mode="manual_full"), WrongMode, 3004, "manual", "automatic"
    ),
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
    Case(
        "manual mode", "fanuc-rmi", first("mode", arm, mode="manual"), WrongMode, 3004, "pendant", "automatic"
    ),
    Case("motors off", "abb", first("motors", arm, on=False), WrongMode, 3004, "motors off", "motors on"),
    Case(
        "motors off", "fanuc", first("motors", arm, on=False), WrongMode, 3004, "servo power off", "motors on"
    ),
    Case("motors off", "ur", first("motors", arm, on=False), WrongMode, 3004, "idle", "release its brakes"),
    Case("manual mode", "yaskawa", first("mode", arm, mode="manual"), WrongMode, 3004, "teach", "REMOTE"),
    Case("motors off", "yaskawa", first("motors", arm, on=False), WrongMode, 3004, "servo", "motors on"),
    Case("an alarm stands", "yaskawa", first("supervise", arm), ProtectiveStop, 4002, "4315", "reset it"),
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
        for bench in ("abb", "abb-simple", "fanuc", "fanuc-io", "fanuc-hmi", "fanuc-rmi", "ur")
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
    Case("an alarm stands", "fanuc-rmi", first("supervise", arm), ProtectiveStop, 4002, "11-050", "reset it"),
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
        "150.* mm, 300 mm are needed now",
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
        for bench in (
            "abb",
            "abb-stock",
            "abb-simple",
            "fanuc",
            "fanuc-io",
            "fanuc-hmi",
            "fanuc-rmi",
            "ur",
            "yaskawa",
        )
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
