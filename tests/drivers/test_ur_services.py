"""Test the UR driver without some services: PolyScope 5.10 and later, and PolyScope X.

Neither dashboard nor port 30003 is there; local control is seen, and a stop gets through.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import (
    ROBOTS,
    LinkError,
    LinkLost,
    MotionStopped,
    NotArmed,
    ProtocolError,
    UrArm,
    UrDeadlines,
    WrongMode,
)
from drivers.link import Address
from drivers.ur.primary import ControllerMessage, parse_message, parse_robot_state
from drivers.ur.robot_api import RobotApi
from drivers.ur.software import DASHBOARD, REALTIME, RTDE, SECONDARY, where_enabled, where_remote
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.faultproxy import FaultProxy
from mocks.world.kinematics import nominal_geometry
from tests.drivers.expected import ExpectedDevice
from tests.drivers.nobody import nobody_listens
from tests.drivers.ur_bench import BRIEF, FAR, PATIENT, creeping
from tests.drivers.waiting import PATIENCE_S, under_way

MENU = "Settings > Security > Services"


@contextmanager
def controller(dialect: str, time_scale: float = 5000.0) -> Iterator[CellThread]:
    with CellThread(
        CellFile(robot="ur5e", time_scale=time_scale, effects=("none",), dialect=dialect), devices=("ur",)
    ) as cell:
        yield cell


def options(cell: CellThread) -> str:
    return f"?api={cell.port('ur-api')}" if any(end.device == "ur-api" for end in cell.endpoints) else ""


def connected(cell: CellThread, deadlines: UrDeadlines = BRIEF) -> UrArm:
    arm = UrArm(cell.url("ur") + options(cell), deadlines=deadlines)
    arm.connect()
    return arm


@pytest.mark.parametrize("dialect", ["polyscope-x", "polyscope-5.21"])
def test_moves_without_dashboard_and_30003(dialect: str) -> None:
    with controller(dialect) as cell:
        arm = connected(cell)
        assert cell.do("state")["joints_deg"] == (0.0,) * 6
        arm.arm()
        assert cell.do("state")["joints_deg"] == (0.0,) * 6
        assert arm.move_to(FAR).joints_deg == pytest.approx(FAR, abs=1e-3)
        assert arm.position().joints_deg == pytest.approx(FAR, abs=1e-3)
        assert (arm.feed, arm.weakness) == ("rtde", "")  # the program is confirmed before it moves
        status = arm.status()
        assert (status.motors_on, status.emergency_stop, status.moving) == (True, False, False)
        assert arm.identify().model == "UR5e"
        assert cell.do("ur_refused")["refused"] == []
        arm.disconnect()


def test_without_rtde_the_primary_interface_serves() -> None:
    with controller("polyscope-x-primary") as cell:
        arm = connected(cell)
        assert arm.feed == "primary"
        assert "PolyScope X 10.12" in arm.weakness
        assert MENU in arm.weakness
        assert RTDE in arm.weakness
        arm.arm()
        for goal in (FAR, (-5.0, -90.0, 5.0, 0.0, 0.0, 0.0)):
            assert arm.move_to(goal).joints_deg == pytest.approx(goal, abs=1e-3)
        assert arm.identify().protocol == "primary"
        cell.do("supervise")
        assert arm.status().error_number == 3
        arm.disconnect()


@pytest.mark.parametrize(
    ("dialect", "words"),
    [
        ("polyscope-x-new", ("PolyScope X 10.11", MENU, RTDE)),
        ("polyscope-5.21-new", ("PolyScope 5.10 or with PolyScope X", MENU, RTDE)),
    ],
)
def test_a_controller_that_nobody_has_opened(dialect: str, words: tuple[str, ...]) -> None:
    """PolyScope X is known by its Robot API, which cannot be closed in this menu."""
    with controller(dialect) as cell:
        arm = UrArm(cell.url("ur") + options(cell))
        with pytest.raises(LinkLost) as caught:
            arm.connect()
    assert "its port is closed" in caught.value.message
    assert all(word in caught.value.what_to_do for word in words)


def test_the_menu_of_each_software() -> None:
    assert "5.9 does not close it" in where_enabled(RTDE, (5, 9, 4))
    assert "3.15 does not close it" in where_enabled(RTDE, (3, 15, 8))
    assert "PolyScope 5.10)" in where_enabled(REALTIME, (5, 10, 0))
    assert MENU in where_enabled(REALTIME, (5, 10, 0))
    assert "PolyScope X 10.12)" in where_enabled(RTDE, (10, 12, 0))
    assert "has no Dashboard Server" in where_enabled(DASHBOARD, (10, 12, 0))
    assert "Settings > System > Remote Control" in where_remote((5, 21))
    assert "safety overview" in where_remote((10, 12))


def test_what_is_closed_is_told_by_its_name_in_the_menu() -> None:
    with controller("polyscope-5.21") as cell:
        arm = connected(cell)
        found = ROBOTS["ur"].details(arm, arm.status())
        arm.disconnect()
    assert set(found.closed) == {REALTIME, SECONDARY, DASHBOARD}
    assert "PolyScope 5.21" in found.opened_at
    assert all(service in found.opened_at for service in found.closed)
    assert found.temperatures_c == pytest.approx((30.0,) * 6)
    assert found.speed_share == 1.0
    assert found.trouble is None


# -- local control -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dialect", "api", "words"),
    [
        ("polyscope-x", True, "safety overview"),  # the Robot API knows
        ("polyscope-x", False, "safety overview"),  # the primary interface answers C210
        ("polyscope-5.21", False, "Settings > System > Remote Control"),
    ],
)
def test_local_control_is_seen_before_anything_moves(dialect: str, api: bool, words: str) -> None:
    with controller(dialect) as cell, nobody_listens() as nobody:
        arm = UrArm(cell.url("ur") + (options(cell) if api else f"?api={nobody}"), deadlines=BRIEF)
        arm.connect()
        assert arm.in_remote_control() is True
        arm.arm()
        cell.do("mode", mode="manual")
        assert arm.in_remote_control() is False
        with pytest.raises(WrongMode, match="local control") as caught:
            arm.arm()
        assert words in caught.value.what_to_do
        assert isinstance(ROBOTS["ur"].details(arm, arm.status()).trouble, WrongMode)
        cell.do("mode", mode="auto")
        arm.arm()
        arm.move_to(FAR)
        arm.disconnect()


def test_switched_to_local_after_arming_is_told_by_the_controller() -> None:
    with controller("polyscope-x") as cell:
        arm = connected(cell, deadlines=replace(PATIENT, start_s=0.3))
        arm.arm()
        cell.do("mode", mode="manual")
        with pytest.raises(WrongMode, match="local control") as caught:
            arm.move_to(FAR)
        assert (caught.value.device, caught.value.command) == ("ur", "move_to")
        assert cell.do("state")["joints_deg"] == (0.0,) * 6
        arm.disconnect()


def test_asking_for_control_leaves_a_program_in_peace() -> None:
    with controller("polyscope-5.21", time_scale=1.0) as cell:
        arm = creeping(cell)
        arm.arm()
        move = under_way(arm, FAR, cell)
        assert arm.in_remote_control() is True
        assert cell.do("state")["moving"]
        arm.stop()
        with pytest.raises(MotionStopped):
            move.result(timeout=PATIENCE_S)
        arm.disconnect()


# -- stop ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dialect", ["polyscope-x", "polyscope-x-primary", "polyscope-5.21"])
def test_stop_without_a_dashboard(dialect: str) -> None:
    with controller(dialect, time_scale=1.0) as cell:
        arm = creeping(cell, options(cell))
        arm.arm()
        move = under_way(arm, FAR, cell)
        arm.stop()
        assert not cell.do("state")["moving"]
        with pytest.raises(MotionStopped):
            move.result(timeout=PATIENCE_S)
        assert max(cell.do("state")["joints_deg"]) < 45.0
        arm.disconnect()


@pytest.mark.parametrize("left", ["secondary", "api"])
def test_stop_where_30001_is_gone(left: str) -> None:
    """PolyScope X loses requests to port 30001; port 30002 or the Robot API takes the stop."""
    with (
        controller("polyscope-x", time_scale=1.0) as cell,
        FaultProxy(cell.port("ur-primary")) as proxy,
        nobody_listens() as nobody,
    ):
        ports = {"primary": proxy.port, "realtime": nobody, "dashboard": nobody}
        ports |= {name: cell.port(f"ur-{name}") if name == left else nobody for name in ("secondary", "api")}
        text = "?" + "&".join(f"{name}={port}" for name, port in ports.items())
        arm = creeping(cell, text, deadlines=replace(PATIENT, stop_s=1.0))
        arm.arm()
        move = under_way(arm, FAR, cell)
        proxy.spoil("request_drop", times=1_000_000)
        arm.stop()
        assert not cell.do("state")["moving"]
        with pytest.raises((MotionStopped, LinkError)):
            move.result(timeout=PATIENCE_S)
        assert max(cell.do("state")["joints_deg"]) < 45.0
        arm.disconnect()


def test_a_stop_under_local_control_is_loud() -> None:
    """The simulated program continues: a person at the pendant has taken control."""
    with controller("polyscope-x", time_scale=1.0) as cell:
        arm = creeping(cell, deadlines=replace(PATIENT, stop_s=0.3))
        arm.arm()
        under_way(arm, FAR, cell)
        assert cell.cell is not None
        cell.cell.arm.mode = "manual"
        with pytest.raises(LinkError):
            arm.stop()
        cell.cell.arm.mode = "auto"
        arm.stop()
        assert not cell.do("state")["moving"]
        arm.disconnect()


# -- the controller's own calibration ------------------------------------------------------------------------


def test_identity_holds_the_calibration_of_the_controller() -> None:
    with controller("polyscope-x") as cell:
        assert cell.cell is not None
        truth, nominal = cell.cell.world.geometry, nominal_geometry(cell.cell.world.robot)
        arm = connected(cell)
        held, factory = arm.identify().calibration, arm.factory()
        arm.disconnect()
    assert held is not None
    assert held.name == factory.calibration
    assert held.checksum == factory.checksum
    assert held.deltas.a_mm == pytest.approx(
        [b - a for a, b in zip(nominal.a, truth.a, strict=True)], abs=1e-9
    )
    assert json.loads(json.dumps(asdict(held)))["deltas"]["d_mm"] == list(held.deltas.d_mm)


def test_software_without_kinematics_has_no_calibration() -> None:
    with controller("polyscope-3.8") as cell:
        assert cell.cell is not None
        cell.cell.ur.software = (3, 5, 4, 1)
        assert UrArm(cell.url("ur")).identify().calibration is None


# -- the wire, written by hand from the maker's guide --------------------------------------------------------


ZERO, ONE = bytes(8), b"\x3f\xf0" + bytes(6)
HALF = b"\x3f\xe0" + bytes(6)


def robot_state(
    clock_us: int, modes: bytes = b"\x01\x01\x01\0\0\0\0\x07\0", safety: int = 1, speed: bytes = ZERO
) -> bytes:
    """Return a state of 378 bytes: all joints at half a radian, target as well."""
    mode = b"\0\0\0\x2f\0" + struct.pack(">Q", clock_us) + modes + ONE * 3 + b"\0"
    joint = HALF + HALF + speed + b"\0\0\0\0\x42\x40\0\0\x41\xf0\0\0\0\0\0\0\xfd"
    board = b"\0\0\0\x4b\x03" + bytes(60) + bytes([safety]) + bytes(9)
    return b"\0\0\x01\x7a\x10" + mode + b"\0\0\0\xfb\x01" + joint * 6 + board


def test_a_state_byte_for_byte() -> None:
    state = parse_robot_state(robot_state(2_500_000)[5:])
    assert state is not None
    assert (state.t_s, state.actual_rad, state.target_rad) == (2.5, (0.5,) * 6, (0.5,) * 6)
    assert (state.robot_mode, state.safety_mode, state.runtime_state) == (7, 1, 1)
    assert (state.temperatures_c, state.speed_share, state.at_rest) == ((30.0,) * 6, 1.0, True)
    playing, paused = (b"\x01\x01\x01\0\0" + flags + b"\x07\0" for flags in (b"\x01\0", b"\0\x01"))
    for modes, runtime in ((playing, 2), (paused, 4)):
        state = parse_robot_state(robot_state(1, modes)[5:])
        assert state is not None
        assert state.runtime_state == runtime
    assert parse_robot_state(robot_state(1)[5 : 5 + 47]) is None  # a state without joints
    with pytest.raises(ProtocolError):
        parse_robot_state(robot_state(1, b"\x02\x01\x01\0\0\0\0\x07\0")[5:])
    with pytest.raises(ProtocolError):
        parse_robot_state(robot_state(1, safety=0)[5:])


def test_the_driver_reads_these_states() -> None:
    version = b"\0\0\0\x22\x14" + bytes(8) + b"\xfe\x03\x09URControl\x0a\x0c\0\0\0\0\0\0\0\0x"[:21]
    version = struct.pack(">I", len(version)) + version[4:]
    with ExpectedDevice([(b"", version + robot_state(1_000_000) + robot_state(1_100_000))]) as device:
        arm = UrArm(f"tcp://127.0.0.1:30004?feed=primary&primary={device.port}")
        assert arm.look().actual_rad == (0.5,) * 6


def test_messages_byte_for_byte() -> None:
    head = bytes(8) + b"\xfe"
    read_only = head + b"\x06\0\0\0\xd2\0\0\0\x01\0\0\0\x02\0\0\0\0\0\0\0\0read\x1b[2Jonly"
    assert parse_message(read_only) == ControllerMessage("C210A1 read [2Jonly", "C210", is_fault=True)
    failed = head + b"\x0a\0\0\0\x03\0\0\0\x07name 'x'"
    assert parse_message(failed) == ControllerMessage("the program failed in line 3: name 'x'", is_fault=True)
    assert parse_message(head + b"\0truepose asks") == ControllerMessage("truepose asks")
    assert parse_message(head + b"\x07\0\0\0\0") is None
    for short in (b"", head, head + b"\x06\0\0"):
        with pytest.raises(ProtocolError):
            parse_message(short)


@given(st.binary(max_size=400))
def test_any_content_of_a_package(data: bytes) -> None:
    for parse in (parse_robot_state, parse_message):
        with suppress(ProtocolError):
            parse(data)


@given(st.integers(0, 372), st.integers(0, 255))
def test_any_state_with_a_wrong_byte(place: int, value: int) -> None:
    content = bytearray(robot_state(1)[5:])
    content[place] = value
    with suppress(ProtocolError):
        parse_robot_state(bytes(content))


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"HTTP/1.1 200 OK\r\nContent-Length: 3\r\n\r\n[1]",
        b'HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\n{"mode":7}',
        b"HTTP/1.1 307 Go\r\nLocation: https://robot/\r\nContent-Length: 0\r\n\r\n",
        b'HTTP/1.1 404 No\r\nContent-Length: 17\r\n\r\n{"mode":"REMOTE"}',
        b'HTTP/1.1 200 OK\r\nContent-Length: 90\r\n\r\n{"mode":',
        b"\xff\xfe",
    ],
)
def test_an_odd_robot_api_tells_nothing(answer: bytes) -> None:
    request = b"GET /universal-robots/robot-api/system/v1/controlmode HTTP/1.1\r\n"
    with ExpectedDevice([(request, answer)]) as device:
        deadlines = UrDeadlines(reply_s=0.3)
        api = RobotApi(Address("127.0.0.1", device.port), "ur", deadlines, None)
        assert api.in_remote_control() is None
        device.faults.clear()  # the header lines that follow the first


def test_the_robot_api_of_each_version() -> None:
    with controller("polyscope-x") as cell:
        assert cell.cell is not None
        ur = cell.cell.ur
        api = RobotApi(Address("127.0.0.1", cell.port("ur-api")), "ur", PATIENT, None)
        ur.software = (10, 11, 0, 0)
        assert (api.in_remote_control(), api.serial(), api.software()) == (None, "", (10, 11))
        ur.software = (10, 14, 1, 0)
        assert (api.in_remote_control(), api.serial(), api.software()) == (True, ur.serial, (10, 14, 1))
        arm = connected(cell)
        assert arm.identify().serial == ur.serial
        cell.do("mode", mode="manual")
        assert api.in_remote_control() is False
        arm.disconnect()


def test_a_stop_while_it_is_asked_for_control_leaves_the_arm_disarmed() -> None:
    with controller("polyscope-x") as cell:
        arm = connected(cell)
        arm.local_control = arm.stop  # type: ignore[method-assign]  # a stop meanwhile
        with pytest.raises(MotionStopped):
            arm.arm()
        with pytest.raises(NotArmed):
            arm.move_to(FAR)
        arm.disconnect()
