"""The UR driver on the simulated controller.

Motion, stop, safety stops, modes, limits, other clients.
"""

from __future__ import annotations

import logging
import math
import socket
import struct
import time
from dataclasses import replace
from itertools import count, repeat
from typing import Any

import numpy as np
import pytest

from drivers import (
    ROBOTS,
    AcquisitionError,
    Busy,
    EmergencyStop,
    EnableLost,
    LinkError,
    LinkLost,
    MotionStopped,
    NotArmed,
    NotReached,
    ProtectiveStop,
    ProtocolError,
    SafetyStop,
    UrArm,
    UrDeadlines,
    WrongMode,
)
from mocks.cell import CellThread
from mocks.ur.servo import COUNT_RAD
from tests.drivers.expected import ExpectedDevice
from tests.drivers.nobody import nobody_listens
from tests.drivers.ur_bench import BRIEF, FAR, PATIENT, connected, creeping
from tests.drivers.waiting import PATIENCE_S, in_thread, under_way

ROBOT, DEVICES = "ur5", ("ur",)


@pytest.fixture(params=["", "?feed=realtime"])
def feed(request: pytest.FixtureRequest) -> str:
    return request.param


def test_which_arm_it_is_without_its_serial_number(fast: CellThread) -> None:
    """Software before 3.12, or a closed dashboard: the factory's calibration is that of one arm."""
    assert fast.cell is not None
    ur = fast.cell.ur
    known, new = UrArm(fast.url("ur")), UrArm(fast.url("ur"))
    assert known.identify().serial == "20155301234"
    ur.serial = ""
    assert known.identify().serial == "20155301234"  # the same calibration
    first = new.identify().serial
    assert first.startswith("calibration-")
    ur.checksum = (7, 2, 3, 4, 5, 6)
    assert len({first, new.identify().serial, "20155301234"}) == 3
    assert known.identify().serial == new.identify().serial
    ur.checksum = (0,) * 6
    assert new.identify().serial == ""
    ur.serial, ur.checksum = "20155301234", None


def test_local_control_is_told_before_a_campaign_falls_over_it(fast: CellThread) -> None:
    assert fast.cell is not None
    ur, arm = fast.cell.ur, UrArm(fast.url("ur"))
    details = ROBOTS["ur"].details
    assert details is not None
    assert UrArm(fast.url("ur")).in_remote_control() is None  # a CB3 does not say
    ur.software = (5, 11, 1, 108318)
    assert arm.in_remote_control() is True
    assert details(arm, arm.status()).trouble is None
    ur.arm.mode = "manual"
    trouble = details(arm, arm.status()).trouble
    ur.arm.mode = "auto"
    assert isinstance(trouble, WrongMode)
    assert "remote control on the pendant" in trouble.what_to_do


def test_goes_there_and_reads_back_in_encoder_counts(fast: CellThread, feed: str) -> None:
    arm = connected(fast, feed, deadlines=BRIEF)
    arm.arm()
    for goal in (FAR, FAR, (-5.0, -90.0, 5.0, 0.0, 0.0, 0.0)):  # the second is where it stands already
        reached = np.radians(arm.move_to(goal).joints_deg)
        assert np.allclose(fast.do("state")["joints_deg"], goal, atol=1e-5)
        assert np.max(np.abs(reached - np.radians(goal))) <= COUNT_RAD
        assert reached / COUNT_RAD == pytest.approx(np.round(reached / COUNT_RAD), abs=1e-6)
        assert arm.position().joints_deg == pytest.approx(np.degrees(reached), abs=1e-9)
    assert fast.do("state")["sides"] == (-1, -1, -1, -1, -1, -1)
    arm.disconnect()


def test_read_back_waits_for_the_arm_and_not_for_the_program(slow: CellThread, feed: str) -> None:
    """The controller ends its program while the joints still creep.

    A reading at that time is a degree off.
    """
    arm = connected(slow, feed)
    arm.arm()
    goal = (12.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    early: list[float] = []
    with socket.create_connection(("127.0.0.1", slow.port("ur-realtime")), timeout=PATIENCE_S) as link:
        link.recv(1140, socket.MSG_WAITALL)
        move = in_thread(lambda: arm.move_to(goal))
        ran = False
        while not early:
            packet = link.recv(1140, socket.MSG_WAITALL)
            running = struct.unpack_from(">d", packet, 1052)[0] == 2.0
            ran = ran or running
            if ran and not running:
                early.append(math.degrees(struct.unpack_from(">d", packet, 252)[0]))
    assert abs(early[0] - goal[0]) > 0.1
    assert move.result(timeout=PATIENCE_S).joints_deg == pytest.approx(goal, abs=0.06)
    assert arm.position().joints_deg == pytest.approx(slow.do("state")["joints_deg"], abs=0.06)
    arm.disconnect()


SAFETY = [
    ({"what": "estop"}, EmergencyStop, 4001),
    ({"what": "supervise"}, ProtectiveStop, 4002),
    ({"what": "motors", "on": False}, EnableLost, 4003),
    ({"what": "ur_safety_mode", "mode": 5}, EnableLost, 4003),
    ({"what": "ur_safety_mode", "mode": 6}, EmergencyStop, 4001),
    ({"what": "ur_safety_mode", "mode": 9}, ProtectiveStop, 4002),
    ({"what": "ur_safety_mode", "mode": 11}, SafetyStop, 4000),
    ({"what": "ur_safety_mode", "mode": 17}, SafetyStop, 4000),
]


@pytest.mark.parametrize(("order", "error", "code"), SAFETY)
def test_safety_during_a_move_is_seen_and_never_resumed(
    slow: CellThread, order: dict[str, Any], error: type[AcquisitionError], code: int
) -> None:
    arm = creeping(slow)
    arm.arm()
    move = under_way(arm, FAR, slow)
    slow.do(**order)
    with pytest.raises(error) as caught:
        move.result(timeout=PATIENCE_S)
    assert (caught.value.code, caught.value.device, caught.value.command) == (code, "ur", "move_to")
    before = slow.do("state")["joints_deg"]
    with pytest.raises((SafetyStop, WrongMode)):
        arm.arm()  # the link is well: no reconnect is needed to hear no
    slow.do("ur_safety_mode", mode=None)
    slow.do("restart")
    slow.do("motors", on=True)
    with pytest.raises(NotArmed):
        arm.move_to(FAR)
    arm.arm()
    assert slow.do("state")["joints_deg"] == before
    arm.disconnect()


@pytest.mark.parametrize(("order", "error", "code"), SAFETY)
def test_arm_refuses_a_controller_that_cannot_move(
    fast: CellThread, feed: str, order: dict[str, Any], error: type[AcquisitionError], code: int
) -> None:
    arm = connected(fast, feed)
    fast.do(**order)
    wanted = WrongMode if order["what"] == "motors" else error
    with pytest.raises(wanted):
        arm.arm()
    status = arm.status()
    assert status.emergency_stop == (error is EmergencyStop)
    assert status.motors_on == (order["what"] not in ("motors", "estop"))
    assert status.moving is False
    arm.disconnect()


def test_local_control_ignores_programs_and_that_is_noticed(fast: CellThread, feed: str) -> None:
    arm = connected(fast, feed, deadlines=replace(PATIENT, start_s=0.3))
    arm.arm()
    fast.do("mode", mode="manual")
    with pytest.raises(WrongMode, match="start_s") as caught:
        arm.move_to(FAR)
    assert "remote" in caught.value.what_to_do
    fast.do("mode", mode="auto")
    arm.deadlines = BRIEF
    arm.arm()
    arm.move_to((1.0, 0, 0, 0, 0, 0))
    arm.disconnect()


def test_two_controlling_clients_are_refused_and_watching_is_not(fast: CellThread) -> None:
    first = connected(fast, deadlines=BRIEF)
    first.arm()
    late_s = repeat(0.0)
    second = connected(fast, deadlines=BRIEF, clock=lambda: time.monotonic() + next(late_s))
    assert second.position().joints_deg == pytest.approx((0.0,) * 6)
    late_s = count(0.0, 0.5)  # at each look: it asks again for `reply_s`, and is answered each time
    with pytest.raises(Busy, match="another program"):
        second.arm()
    late_s = repeat(0.0)
    first.move_to((1.0, 0, 0, 0, 0, 0))
    first.disconnect()
    second.arm()
    second.move_to((2.0, 0, 0, 0, 0, 0))
    second.disconnect()


def send_script(cell: CellThread, text: bytes) -> None:
    with socket.create_connection(("127.0.0.1", cell.port("ur-secondary")), timeout=PATIENCE_S) as link:
        link.sendall(text)
        link.shutdown(socket.SHUT_WR)
        while link.recv(4096):  # closing earlier, with states unread, would reset the connection
            pass


def test_a_program_on_the_controller_is_not_aborted(slow: CellThread, feed: str) -> None:
    arm = creeping(slow, feed)
    arm.arm()
    send_script(slow, b"movej([1.5,0,0,0,0,0],a=1,v=0.5)\n")
    with pytest.raises(Busy):
        arm.move_to(FAR)
    with pytest.raises(Busy):
        arm.arm()
    assert slow.do("state")["moving"]
    arm.disconnect()


def test_a_program_that_replaces_ours_is_not_its_end(slow: CellThread, feed: str) -> None:
    arm = creeping(slow, feed)
    arm.arm()
    move = under_way(arm, FAR, slow)
    send_script(slow, b"movej([0.1,0,0,0,0,0],a=1,v=1)\n")
    with pytest.raises(MotionStopped, match="before its target"):
        move.result(timeout=PATIENCE_S)
    arm.disconnect()


def test_low_speed_slider_ends_within_the_deadline(slow: CellThread) -> None:
    arm = connected(slow, deadlines=replace(PATIENT, move_factor=0.0, move_margin_s=0.3))
    slow.do("ur_speed_slider", fraction=0.05)
    arm.arm()
    with pytest.raises(NotReached, match="slider"):
        arm.move_to(FAR)
    assert not slow.do("state")["moving"]
    arm.disconnect()


def test_limit_of_the_controller_is_a_protective_stop(fast: CellThread) -> None:
    arm = connected(fast)
    arm.arm()
    assert fast.cell is not None
    fast.cell.arm.limits_deg = [(-30.0, 30.0)] * 6
    with pytest.raises(ProtectiveStop):
        arm.move_to(FAR)
    assert fast.do("state")["joints_deg"] == (0.0,) * 6
    arm.disconnect()


def test_controller_without_registers_moves_without_a_watchdog(fast: CellThread) -> None:
    fast.do("ur_registers", on=False)
    arm = connected(fast)
    arm.arm()
    assert arm.feed == "rtde"
    assert arm.move_to(FAR).joints_deg == pytest.approx(FAR, abs=1e-3)
    assert fast.do("ur_refused")["refused"] == []
    arm.disconnect()


def test_without_rtde_the_real_time_packet_serves(fast: CellThread, caplog: pytest.LogCaptureFixture) -> None:
    options = "&".join(f"{name}={fast.port('ur-' + name)}" for name in ("realtime", "secondary", "dashboard"))
    with nobody_listens() as closed, caplog.at_level(logging.WARNING):
        arm = UrArm(f"tcp://127.0.0.1:{closed}?{options}")
        arm.connect()
    assert arm.feed == "realtime"
    assert any("no watchdog" in record.message for record in caplog.records)
    arm.arm()
    assert arm.move_to(FAR).joints_deg == pytest.approx(FAR, abs=1e-3)
    assert arm.identify().protocol == "realtime"
    arm.disconnect()


def test_tool_speed_is_held_by_the_speed_of_the_joint(fast: CellThread) -> None:
    assert fast.cell is not None
    fast.cell.ur.registers.served = False
    arm = connected(fast, speed_mm_s=100.0, speed_deg_s=20.0)
    arm.arm()
    speeds: list[float] = []
    for goal in (
        (50.0, 0, 0, 0, 0, 0),
        (50.0, 0, 0, 0, 1.0, 0),
        (50.0, 0, 0, 0, 1.0, 1.0),
        (40.0, 10.0, 0, 0, 1.0, 1.0),
    ):
        arm.move_to(goal)
        speeds.append(max(map(abs, fast.cell.arm.move.speed_deg_s)))
    arm.disconnect()
    assert speeds == pytest.approx(
        [*(math.degrees(0.1 / lever) for lever in (1.0, 0.3)), 20.0, math.degrees(0.05)], rel=1e-3
    )


def test_factory_kinematics(fast: CellThread) -> None:
    assert fast.cell is not None
    truth = fast.cell.world.geometry
    arm = connected(fast)
    factory = arm.factory()
    arm.disconnect()
    assert factory.model == "UR5"
    assert factory.nominal.links()[1] == pytest.approx(
        {"alpha_deg": 0.0, "a_mm": -425.0, "theta_deg": 0.0, "d_mm": 0.0}
    )
    assert factory.calibrated is not None
    assert factory.correction is not None
    assert factory.calibrated.a_mm == pytest.approx(truth.a)
    assert factory.calibrated.d_mm == pytest.approx(truth.d)
    assert np.radians(factory.calibrated.alpha_deg) == pytest.approx(truth.alpha)
    assert np.radians(factory.calibrated.theta_deg) == pytest.approx(truth.theta)
    assert factory.correction.a_mm[1] == pytest.approx(truth.a[1] + 425.0)
    assert len(factory.checksum) == 6


def test_factory_kinematics_before_software_3_6(fast: CellThread) -> None:
    assert fast.cell is not None
    fast.cell.ur.software = (3, 5, 4, 1)
    factory = UrArm(fast.url("ur")).factory()
    assert factory.firmware == "3.5.4"
    assert factory.calibrated is None
    assert factory.correction is None


@pytest.mark.parametrize(("software", "model"), [((3, 15, 8, 1), "UR5"), ((5, 12, 6, 1), "UR5e")])
def test_the_software_tells_the_series_of_the_arm(
    fast: CellThread, software: tuple[int, int, int, int], model: str
) -> None:
    """A UR5 and a UR5e have the same type, and differ by 70 mm."""
    assert fast.cell is not None
    fast.cell.ur.software = software
    assert UrArm(fast.url("ur")).factory().model == model


@pytest.mark.parametrize("port", ["ur-dashboard", "ur-secondary", "ur-realtime", "backdoor"])
def test_wrong_device_on_the_port(fast: CellThread, port: str) -> None:
    arm = UrArm(f"tcp://127.0.0.1:{fast.port(port)}", deadlines=UrDeadlines(reply_s=0.4))
    with pytest.raises(LinkError):
        arm.connect()


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ([(b"\x00\x05V\x00\x02", b"\x00\x04V\x00")], "version 2"),
        ([(b"\x00\x05V\x00\x02", b"\x00\x04V\x01"), (b"\x00\x03v", b"\x00\x04v\x01")], "controller version"),
    ],
)
def test_controller_of_another_protocol(pairs: list[tuple[bytes, bytes]], message: str) -> None:
    with ExpectedDevice(pairs) as device:
        arm = UrArm(f"tcp://127.0.0.1:{device.port}")
        with pytest.raises(ProtocolError, match=message) as caught:
            arm.connect()
    assert (caught.value.device, caught.value.command) == ("ur", "connect")


def test_nobody_at_the_address() -> None:
    with nobody_listens() as port, pytest.raises(LinkLost):
        UrArm(f"tcp://127.0.0.1:{port}").connect()


@pytest.mark.parametrize(("asked", "driven"), [(2.0, 2.0), (90.0, 20.0)])
def test_a_path_may_be_slower_than_the_arm_and_never_faster(
    fast: CellThread, asked: float, driven: float
) -> None:
    arm = UrArm(fast.url("ur"), speed_mm_s=5000.0, speed_deg_s=20.0, deadlines=PATIENT)
    arm.connect()
    arm.arm()
    assert fast.cell is not None
    simulated = fast.cell.arm
    with arm.at_speed(asked):
        arm.move_to((10.0, -4.0, 0.0, 0.0, 0.0, 0.0))
        assert np.max(np.abs(simulated.move.speed_deg_s)) == pytest.approx(driven, rel=1e-3)
    arm.move_to((-10.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert np.max(np.abs(simulated.move.speed_deg_s)) == pytest.approx(20.0, rel=1e-3)
    arm.disconnect()
