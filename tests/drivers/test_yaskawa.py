"""Test the Yaskawa driver on its simulator.

Covered are datagrams that UDP spoils, states of the controller, pulses and the job.
"""

from __future__ import annotations

import itertools
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition.cell import cell_from
from calib.text import read_toml
from drivers import (
    AcquisitionError,
    Busy,
    ConfigError,
    LinkTimeout,
    MotionStopped,
    NotArmed,
    NotReady,
    ProtectiveStop,
    ProtocolError,
    WrongMode,
    YaskawaArm,
    YaskawaDeadlines,
)
from drivers.link import Address
from drivers.yaskawa.hses import STATUS as STATUS_QUESTION
from drivers.yaskawa.hses import HsesLink, Question, refusal
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.yaskawa.controller import MAX_DEG_S, YaskawaController, shipped_job
from mocks.yaskawa.inform import Job, JointMotion, Variables
from tests.drivers.waiting import PATIENCE_S, under_way, until

# MA1440 and MA2010 as measured by hehonglu123/Welding_Motoman (config/*_pulse2deg_real.csv).
MA1440 = (1435.350459, 1300.317471, 1422.222174, 969.9555508, 980.2392898, 454.754161)
MA2010 = (1341.380023, 1907.674052, 1592.888923, 1022.862207, 980.2392898, 454.754161)
CALM = YaskawaDeadlines(reply_s=5.0, start_s=30.0, settle_s=30.0, move_margin_s=60.0, gap_s=0.001)
NUMBERS = {"pulses_per_deg": MA1440, "max_deg_s": MAX_DEG_S}
TARGET = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
FAR = (90.0, 60.0, 30.0, 40.0, 50.0, 60.0)
STATUS, HOLD, START, SELECT = 0x72, 0x83, 0x86, 0x87


@contextmanager
def simulated(time_scale: float = 5000.0, **changes: Any) -> Iterator[CellThread]:
    file = CellFile(robot="yaskawa-gp7", time_scale=time_scale, effects=("none",), pulses_per_deg=MA1440)
    with CellThread(replace(file, **changes), devices=("yaskawa",)) as cell:  # type: ignore[arg-type]
        yield cell


@pytest.fixture
def cell() -> Iterator[CellThread]:
    with simulated() as cell:
        yield cell


@pytest.fixture
def slow() -> Iterator[CellThread]:
    with simulated(1.0) as cell:
        yield cell


def controller_of(cell: CellThread) -> YaskawaController:
    assert cell.cell is not None
    return cell.cell.yaskawa


def connected(cell: CellThread, **options: Any) -> YaskawaArm:
    arm = YaskawaArm(cell.url("yaskawa"), **{"deadlines": CALM, **NUMBERS, **options})  # type: ignore[arg-type]
    arm.connect()
    return arm


# -- states of the controller --------------------------------------------------------------------------------


def teach(on: YaskawaController) -> None:
    on.arm.mode = "manual"


def servo_off(on: YaskawaController) -> None:
    on.arm.motors_on = False


def remote_off(on: YaskawaController) -> None:
    on.remote = False


def alarm(on: YaskawaController) -> None:
    on.alarm = 4315, "COLLISION DETECT"


def error(on: YaskawaController) -> None:
    on.error = True


def held(who: str, on: YaskawaController) -> None:
    on.holds.add(who)


def busy_file(on: YaskawaController) -> None:
    on.file_busy = True


def other_job_runs(on: YaskawaController) -> None:
    on.running = True


def job_missing(on: YaskawaController) -> None:
    del on.jobs["TRUEPOSE1"]


@pytest.mark.parametrize(
    ("spoil", "kind", "says", "do"),
    [
        (teach, WrongMode, "teach", "REMOTE"),
        (servo_off, WrongMode, "servo", "motors on"),
        (remote_off, WrongMode, "command remote", "REMOTE"),
        (alarm, ProtectiveStop, "4315: COLLISION DETECT", "reset"),
        (error, ProtectiveStop, "pendant", "reset"),
        (partial(held, "pendant"), NotReady, "held by the pendant", "Release"),
        (partial(held, "external"), NotReady, "external", "Release"),
        (busy_file, Busy, "edited", "pendant has closed"),
        (other_job_runs, Busy, "running", "other program"),
        (job_missing, NotReady, "no job TRUEPOSE1", "TRUEPOSE1.JBI"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_a_controller_that_cannot_move_is_not_armed(
    cell: CellThread,
    spoil: Callable[[YaskawaController], None],
    kind: type[AcquisitionError],
    says: str,
    do: str,
) -> None:
    arm = connected(cell)
    spoil(controller_of(cell))
    with pytest.raises(kind, match=says) as caught:
        arm.arm()
    assert do in caught.value.what_to_do
    with pytest.raises(NotArmed):
        arm.move_to(TARGET)
    assert controller_of(cell).arm.sent_to == []
    arm.disconnect()


def test_status_shows_mode_servo_alarm_and_motion(slow: CellThread) -> None:
    arm, on = connected(slow, speed_deg_s=4.0), controller_of(slow)
    status = arm.status()
    assert (status.mode, status.motors_on, status.emergency_stop, status.moving) == (
        "auto",
        True,
        None,
        False,
    )
    arm.arm()
    move = under_way(arm, FAR, slow)
    assert arm.status().moving
    alarm(on)
    on.arm.wake()
    with pytest.raises(ProtectiveStop, match="4315"):
        move.result(PATIENCE_S)
    assert arm.status().error_number == 4315
    trouble = arm.trouble()
    assert trouble is not None
    assert "COLLISION" in trouble.message
    teach(on)
    servo_off(on)
    assert (arm.status().mode, arm.status().motors_on) == ("manual", False)
    arm.disconnect()


def test_a_hold_on_the_pendant_ends_the_move_and_its_release_does_not_resume_it(slow: CellThread) -> None:
    arm, on = connected(slow, speed_deg_s=4.0), controller_of(slow)
    arm.arm()
    move = under_way(arm, FAR, slow)
    on.hold("pendant", on=True)
    with pytest.raises(MotionStopped, match="pendant"):
        move.result(PATIENCE_S)
    there = on.arm.joints_deg()
    on.hold("pendant", on=False)
    arm.arm()  # releases the driver's own hold as well, and forgets the held job
    assert on.holds == set()
    assert on.arm.joints_deg() == there
    arm.move_to(there)
    assert len(on.arm.sent_to) == 2
    arm.disconnect()


def test_stop_ends_a_move_although_its_questions_get_no_answer(slow: CellThread) -> None:
    """The hold goes over its own port: no question that waits in vain delays it."""
    arm, on = (
        connected(slow, speed_deg_s=4.0, deadlines=replace(CALM, reply_s=PATIENCE_S)),
        controller_of(slow),
    )
    arm.arm()
    move = under_way(arm, FAR, slow)
    swallow(slow, lambda request: request[24] not in (HOLD, STATUS))
    begun = time.monotonic()
    arm.stop()
    until(lambda: not on.arm.moving)
    assert time.monotonic() - begun < PATIENCE_S / 2
    assert on.arm.joints_deg()[0] < 60.0
    arm.disconnect()
    with pytest.raises(AcquisitionError):
        move.result(PATIENCE_S)


def swallow(cell: CellThread, these: Callable[[bytes], bool]) -> None:
    """Let the simulated server carry out some requests without an answer."""
    assert cell.cell is not None
    protocol: Any = cell.cell._servers._datagrams[0].get_protocol()
    answer = protocol._answer

    def spoiled(request: bytes) -> bytes | None:
        given = answer(request)
        return None if these(request) else given

    protocol._answer = spoiled


# -- datagrams -----------------------------------------------------------------------------------------------


class Relay:
    """A controller's port whose answers to each request a test chooses.

    `deal(request, ask)` returns the answers.
    """

    def __init__(self, port: int, deal: Callable[[bytes, Callable[[bytes], bytes]], list[bytes]]) -> None:
        self._device = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._device.connect(("127.0.0.1", port))
        self._device.settimeout(PATIENCE_S)
        self._door = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._door.bind(("127.0.0.1", 0))
        self._deal = deal
        self.url = f"udp://127.0.0.1:{self._door.getsockname()[1]}"
        self.requests: list[bytes] = []
        self._thread = threading.Thread(target=self._run, daemon=True)

    def ask(self, request: bytes) -> bytes:
        self._device.send(request)
        return self._device.recv(4096)

    def _run(self) -> None:
        while True:
            request, client = self._door.recvfrom(4096)
            if not request:
                return
            self.requests.append(request)
            for answer in self._deal(request, self.ask):
                self._door.sendto(answer, client)

    def __enter__(self) -> Relay:
        self._thread.start()
        return self

    def __exit__(self, *unused: object) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as last:
            last.sendto(b"", self._door.getsockname())
        self._thread.join(PATIENCE_S)
        self._door.close()
        self._device.close()


def relayed(relay: Relay, **changes: float) -> YaskawaArm:
    return YaskawaArm(relay.url, deadlines=replace(CALM, **{"reply_s": 0.1, **changes}), **NUMBERS)  # type: ignore[arg-type]


def test_late_and_repeated_answers_are_told_apart_by_their_number(cell: CellThread) -> None:
    """Each answer comes after the one to the request before, and twice."""
    before: list[bytes] = []

    def deal(request: bytes, ask: Callable[[bytes], bytes]) -> list[bytes]:
        late, answer = before[-1:], ask(request)
        before.append(answer)
        return [*late, answer, answer]

    with Relay(cell.port("yaskawa"), deal) as relay:
        arm = relayed(relay)
        arm.connect()
        arm.arm()
        for i in range(3):
            target = (float(i), *TARGET[1:])
            assert arm.move_to(target).joints_deg == pytest.approx(target, abs=0.0012)
        arm.disconnect()
    assert len(before) > 50
    assert [request[11] for request in relay.requests[:3]] == [1, 2, 3]
    assert len(controller_of(cell).arm.sent_to) == 3


def test_a_lost_datagram_is_asked_for_again_and_silence_ends_the_connection(cell: CellThread) -> None:
    lost = itertools.count()

    def deal(request: bytes, ask: Callable[[bytes], bytes]) -> list[bytes]:
        return [] if next(lost) % 3 == 1 else [ask(request)]

    with Relay(cell.port("yaskawa"), deal) as relay:
        arm = relayed(relay)
        arm.connect()
        assert arm.position().joints_deg == (0.0,) * 6
        relay._deal = lambda request, ask: []
        with pytest.raises(LinkTimeout, match="3 x reply_s"):
            arm.status()
        numbers = [request[11] for request in relay.requests]
        assert numbers == list(range(1, len(numbers) + 1))  # a new one each time
        arm.disconnect()


def test_a_start_without_an_answer_is_not_repeated(cell: CellThread) -> None:
    def deal(request: bytes, ask: Callable[[bytes], bytes]) -> list[bytes]:
        answer = ask(request)
        return [] if request[24] == START else [answer]

    with Relay(cell.port("yaskawa"), deal) as relay:
        arm = relayed(relay)
        arm.connect()
        arm.arm()
        arm.move_to(TARGET)  # the echo of the job tells
        arm.disconnect()
    assert sum(request[24] == START for request in relay.requests) == 1


def test_a_start_that_comes_twice_or_late_moves_the_robot_once(cell: CellThread) -> None:
    starts: list[bytes] = []

    def deal(request: bytes, ask: Callable[[bytes], bytes]) -> list[bytes]:
        if request[24] == START:
            starts.append(request)
            return [ask(request), ask(request)]
        return [ask(request)]

    on = controller_of(cell)
    with Relay(cell.port("yaskawa"), deal) as relay:
        arm = relayed(relay)
        arm.connect()
        arm.arm()
        arm.move_to(TARGET)
        for _ in range(3):
            until(lambda: not on.running)
            relay.ask(starts[0])
        until(lambda: not on.running)
        arm.disconnect()
    assert len(on.arm.sent_to) == 1


def test_a_start_that_was_lost_for_long_finds_nothing_to_do(cell: CellThread) -> None:
    """The start arrives after the driver abandoned it and was armed again, before any motion."""
    late: list[bytes] = []

    def deal(request: bytes, ask: Callable[[bytes], bytes]) -> list[bytes]:
        if request[24] == START:
            late.append(request)
            return []
        return [ask(request)]

    on = controller_of(cell)
    with Relay(cell.port("yaskawa"), deal) as relay:
        arm = relayed(relay, start_s=0.05)
        arm.connect()
        arm.arm()
        with pytest.raises(LinkTimeout, match="has not taken"):
            arm.move_to(TARGET)
        relay.ask(late[0])  # refused: the driver holds the robot
        assert not on.running
        arm.connect()
        arm.arm()
        relay.ask(late[0])
        until(lambda: not on.running)
        arm.disconnect()
    assert on.arm.sent_to == []


@pytest.mark.parametrize("what", ["target", "speed", "number", "sum"])
def test_a_target_that_arrives_damaged_is_refused_by_the_job(cell: CellThread, what: str) -> None:
    variable = {"speed": 96, "number": 90, "sum": 91}.get(what)
    armed = threading.Event()

    def deal(request: bytes, ask: Callable[[bytes], bytes]) -> list[bytes]:
        command, instance, _, service = struct.unpack("<HHBB", request[24:30])
        wanted = (
            (command, instance) == (0x7F, 90) if variable is None else (command, instance) == (0x7C, variable)
        )
        if armed.is_set() and wanted and service in (0x02, 0x10):
            place = 32 if variable is not None else 32 + 20
            request = request[:place] + bytes([request[place] ^ 0x40]) + request[place + 1 :]
        return [ask(request)]

    with Relay(cell.port("yaskawa"), deal) as relay:
        arm = relayed(relay, start_s=0.1)
        arm.connect()
        arm.arm()
        armed.set()
        with pytest.raises((ProtocolError, LinkTimeout)):
            arm.move_to(TARGET)
        arm.disconnect()
    assert controller_of(cell).arm.sent_to == []


@pytest.mark.parametrize("line", [1 << bit for bit in range(6)])
def test_a_job_that_is_selected_from_a_later_line_is_not_started(cell: CellThread, line: int) -> None:
    """One wrong bit of the request leads behind the checks of the job."""
    armed = threading.Event()

    def deal(request: bytes, ask: Callable[[bytes], bytes]) -> list[bytes]:
        if request[24] == SELECT and armed.is_set():
            request = request[:-4] + bytes([line, 0, 0, 0])
        return [ask(request)]

    with Relay(cell.port("yaskawa"), deal) as relay:
        arm = relayed(relay)
        arm.connect()
        arm.arm()
        armed.set()
        if line == 1:
            arm.move_to(TARGET)
        else:
            with pytest.raises(AcquisitionError):
                arm.move_to(TARGET)
            assert START not in [request[24] for request in relay.requests]
        arm.disconnect()
    assert len(controller_of(cell).arm.sent_to) == (line == 1)


def test_a_hold_that_arrives_as_another_switch_is_ordered_again(cell: CellThread) -> None:
    """One wrong bit makes HLOCK of it, which the controller accepts as well."""
    holds = itertools.count()

    def deal(request: bytes, ask: Callable[[bytes], bytes]) -> list[bytes]:
        if request[24] == HOLD and next(holds) == 0:
            request = request[:26] + bytes([3]) + request[27:]
        return [ask(request)]

    with Relay(cell.port("yaskawa"), deal) as relay:
        arm = relayed(relay)
        arm.stop()
    assert controller_of(cell).holds == {"command"}
    assert next(holds) == 2


def other_form(request: bytes) -> bytes:
    """An answer whose fields follow each other differently: command, status at byte 26."""
    return request[:10] + b"\1" + request[11:26] + b"\0\0\0\0" + request[30:] + bytes(8)


@pytest.mark.parametrize(
    "answer",
    [
        lambda request: b"0:success",
        lambda request: request,
        other_form,
        lambda request: b"YERC" + bytes(28),
        lambda request: request[:10] + b"\1" + request[11:24] + b"\x81\x08" + bytes(6),  # status 0x08
    ],
    ids=["text", "echo", "other fields", "empty", "unknown command"],
)
def test_another_controller_on_that_port(cell: CellThread, answer: Callable[[bytes], bytes]) -> None:
    with Relay(cell.port("yaskawa"), lambda request, ask: [answer(request)]) as relay:
        arm = relayed(relay)
        with pytest.raises(ProtocolError) as caught:
            arm.connect()
    assert "this address" in caught.value.what_to_do


def test_a_job_of_more_axes_is_refused(cell: CellThread) -> None:
    def deal(request: bytes, ask: Callable[[bytes], bytes]) -> list[bytes]:
        answer = ask(request)
        return [answer[:-8] + struct.pack("<ii", 5, 0) if request[24] == 0x75 else answer]

    with Relay(cell.port("yaskawa"), deal) as relay, pytest.raises(ProtocolError, match="six axes"):
        relayed(relay).connect()


def answered(question: Question, data: bytes) -> bool:
    """Return whether the first request of a connection takes a datagram as its answer."""
    link = HsesLink(Address("h", 1), "yaskawa", CALM, time.monotonic)
    link._number = 1
    return link._is_answer(question, data)


GOOD = bytes.fromhex(
    "59455243 2000 0800 03 01 01 01 00000080 3939393939393939 81 00 00 00 0000 0000"
) + bytes(8)
SILENT = {11}  # the number of another request
SECOND = {
    12,
    13,
    14,
    15,
    25,
    26,
    27,
    28,
    29,
    30,
    31,
}  # block, status and padding decide nothing about the form


def test_an_answer_byte_by_byte() -> None:
    """The status answer that the DX100 manual prints is valid until a field of its form changes."""
    assert answered(STATUS_QUESTION, GOOD)
    for place in range(32):
        changed = GOOD[:place] + bytes([GOOD[place] ^ 4]) + GOOD[place + 1 :]
        if place in SILENT:
            assert not answered(STATUS_QUESTION, changed)
        elif place in SECOND - {25}:
            assert answered(STATUS_QUESTION, changed)
        else:  # a status of 4 has no data
            with pytest.raises(ProtocolError):
                answered(STATUS_QUESTION, changed)


@given(st.one_of(st.binary(max_size=120), st.binary(max_size=80).map(lambda rest: GOOD[:16] + rest)))
def test_any_bytes_as_an_answer(data: bytes) -> None:
    if data[:25] != GOOD[:25]:
        with pytest.raises(ProtocolError):
            answered(STATUS_QUESTION, data)


@given(st.integers(0, 255), st.integers(0, 0xFFFF))
def test_any_refusal_is_an_error_of_ours(status: int, added: int) -> None:
    found = refusal(status, added, "yaskawa", STATUS_QUESTION, b"")
    assert isinstance(found, AcquisitionError)
    assert found.what_to_do
    assert isinstance(found, ProtocolError) == (status != 0x1F)


# -- pulses and speeds ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("per_deg", "axis", "degrees", "pulses"),
    [
        (MA1440, 2, 90.0, 128000),  # 512 000 pulses a turn
        (MA1440, 5, 180.0, 81856),  # 163 711.5 a turn
        (MA1440, 0, -45.0, -64591),
        (MA2010, 0, 30.0, 40241),
        (MA2010, 1, -10.0, -19077),
    ],
)
def test_degrees_are_the_pulses_of_that_arm(
    per_deg: tuple[float, ...], axis: int, degrees: float, pulses: int
) -> None:
    """The pulses were calculated by hand, and are read in the position variable that arrived."""
    with simulated(pulses_per_deg=per_deg) as cell:
        arm, on = connected(cell, pulses_per_deg=per_deg), controller_of(cell)
        arm.arm()
        target = tuple(degrees if i == axis else 0.0 for i in range(6))
        reading = arm.move_to(target)
        assert on.variables.positions[90] == tuple(pulses if i == axis else 0 for i in range(8))
        assert on.pulses()[axis] == pulses
        assert reading.joints_deg[axis] == pytest.approx(degrees, abs=0.5 / per_deg[axis])
        assert reading.resolution_deg == pytest.approx(0.0022, abs=1e-5)
        arm.disconnect()


def test_wrong_numbers_move_the_robot_elsewhere(cell: CellThread) -> None:
    """Only a person can notice that; the page describes how to compare."""
    arm = connected(cell, pulses_per_deg=MA2010)
    arm.arm()
    arm.move_to((0.0, 10.0, 0.0, 0.0, 0.0, 0.0))
    assert controller_of(cell).arm.joints_deg()[1] == pytest.approx(10.0 * MA2010[1] / MA1440[1], abs=0.001)
    arm.disconnect()


@pytest.mark.parametrize(("speed_deg_s", "speed_mm_s"), [(20.0, 500.0), (5.0, 500.0), (20.0, 50.0)])
def test_no_joint_is_faster_than_the_cell_allows(speed_deg_s: float, speed_mm_s: float) -> None:
    with simulated() as cell:
        arm, on = connected(cell, speed_deg_s=speed_deg_s, speed_mm_s=speed_mm_s), controller_of(cell)
        arm.arm()
        arm.move_to((0.0, 0.0, 0.0, 0.0, 0.0, 30.0))
        share = on.variables.value("I090") / 10_000
        assert 0.0 < MAX_DEG_S[5] * share <= speed_deg_s
        assert MAX_DEG_S[5] * share <= speed_mm_s / 400.0 * 57.3
        arm.disconnect()


def test_the_cell_file_needs_six_numbers_of_the_arm() -> None:
    file = Path(__file__).parents[2] / "examples" / "gp7_faro" / "cell.toml"
    table = read_toml(file)[1]
    assert cell_from(table, str(file)).robot.options["pulses_per_deg"] == tuple(
        table["robot"]["pulses_per_deg"]
    )
    for wrong in ([1000.0] * 5, [1000.0] * 5 + [0.0], "1000", None):
        robot = {key: value for key, value in table["robot"].items() if key != "pulses_per_deg"}
        if wrong is not None:
            robot["pulses_per_deg"] = wrong
        with pytest.raises(ConfigError, match="pulses_per_deg"):
            cell_from(table | {"robot": robot}, str(file))


# -- the job of the robot side -------------------------------------------------------------------------------


def run(job: Job, variables: Variables) -> list[JointMotion]:
    """The motions of a job that runs to its end."""
    at: int | None = 0
    moves = []
    while at is not None:
        at, motion = job.step(at, variables)
        moves += [motion] if motion else []
    return moves


def test_the_job_moves_once_to_a_target_that_fits_its_sum() -> None:
    job, variables = Job(shipped_job()), Variables()
    pulses = (1, -2, 3, -4, 5, -6, 0, 0)
    variables.positions[90] = pulses
    total = 7 + 3 * 250 + 5 * 1 + 7 * -2 + 11 * 3 + 13 * -4 + 17 * 5 + 19 * -6
    variables.numbers |= {"D090": 7, "D096": 250, "D091": total}
    assert run(job, variables) == [JointMotion(pulses, 250, 0)]
    assert (variables.value("D092"), variables.value("D093")) == (72, 7)
    assert run(job, variables) == []
    assert variables.value("D092") == 72


@pytest.mark.parametrize("spoil", ["D090", "D091", "D096", *range(6)])
def test_the_job_refuses_any_one_value_that_is_wrong(spoil: str | int) -> None:
    job, variables = Job(shipped_job()), Variables()
    pulses = [1000, -2000, 3000, -4000, 5000, -6000, 0, 0]
    weights = (5, 7, 11, 13, 17, 19)
    total = 8 + 3 * 250 + sum(w * p for w, p in zip(weights, pulses, strict=False))
    variables.numbers |= {"D090": 8, "D096": 250, "D091": total}
    if isinstance(spoil, int):
        pulses[spoil] ^= 64
    else:
        variables.numbers[spoil] ^= 64
    variables.positions[90] = tuple(pulses)
    assert run(job, variables) == []
    assert variables.value("D092") % 10 == 3


def test_the_job_is_short_enough_for_any_controller() -> None:
    lines = shipped_job().splitlines()
    assert all(len(line) <= 32 for line in lines)
    assert all(line.isascii() for line in lines)
    assert lines.index("NOP") > lines.index("//INST")
