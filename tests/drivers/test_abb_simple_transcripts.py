"""Golden conversation of abb_driver's simple_message, with the driver and the simulator.

Written by hand from the layout of the messages. Parts of pi as float32 are 45 deg 3f490fdb and 90 deg 3fc90fdb; 1.5 is
3fc00000. A missing axis, 9e9 mm in the controller, is 9e6 m, 4b095440. All values have the low byte first.
"""

from __future__ import annotations

import contextlib
import math
import socket
import threading
from collections.abc import Iterable, Iterator

import pytest

from drivers import AbbSimpleArm, CommandRefused, ProtocolError
from drivers.abb.simple_packets import AbbState, parse_state
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.drivers.expected import ExpectedDevice, Pair, converse
from tests.drivers.waiting import PATIENCE_S

FAST = CellFile(time_scale=10_000.0, effects=("none",))
TARGET = (90.0, -45.0, 0.0, 0.0, 0.0, 90.0)

ZERO, P45, P90, M45 = "00000000", "db0f493f", "db0fc93f", "db0f49bf"
NO_AXES = 4 * "4054094b"
HERE, THERE = 6 * ZERO + NO_AXES, P90 + M45 + 3 * ZERO + P90 + NO_AXES
POINT = "40000000 0b000000 02000000 00000000"
TAKEN = bytes.fromhex("0c000000 0b000000 03000000 01000000")
FAILED = bytes.fromhex("0c000000 0b000000 03000000 02000000")
HALT = bytes.fromhex(f"{POINT} fcffffff {10 * ZERO} {ZERO} {ZERO}")
FIRST = bytes.fromhex(f"{POINT} ffffffff {HERE} {ZERO} 0000c03f")
LAST = bytes.fromhex(f"{POINT} fdffffff {THERE} {ZERO} 0000c03f")
MOVE: list[Pair] = [(HALT, TAKEN), (FIRST, TAKEN), (LAST, TAKEN), (HALT, TAKEN)]

JOINT, TOPIC = "38000000 0a000000", "01000000 00000000"
STANDS = f"28000000 0d000000 {TOPIC} 01000000 00000000 00000000 00000000 00000000 02000000 01000000"
AT_HERE = bytes.fromhex(f"{JOINT} {TOPIC} {ZERO} {HERE} {STANDS}")
AT_THERE = bytes.fromhex(f"{JOINT} {TOPIC} {ZERO} {THERE} {STANDS}")


class Pusher:
    """A state server that pushes `state` every few milliseconds to one client after another."""

    def __init__(self, state: bytes) -> None:
        self.state = state
        self._end = threading.Event()
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        while not self._end.is_set():
            client, _ = self._server.accept()
            with client, contextlib.suppress(OSError):
                while not self._end.wait(0.002):
                    client.sendall(self.state)

    def __enter__(self) -> Pusher:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        with (
            contextlib.suppress(OSError),
            socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S),
        ):
            self._thread.join()
        self._server.close()


class Told:
    """States in the place of a stream, one after another; the last one stays."""

    def __init__(self, states: Iterable[bytes]) -> None:
        self._states = [parse_state(state) for state in states]
        self.count = 0

    def following(self, number: int, command: str) -> tuple[int, AbbState]:
        self.count = number + 1
        return self.count, self._states[min(number, len(self._states) - 1)]


def moving(pusher: Pusher) -> Iterator[Pair]:
    """The motion server's side of MOVE; the states change when it has read the last point."""
    for pair in MOVE:
        yield pair
        if pair[0] == LAST:
            pusher.state = AT_THERE


def arm_at(device: ExpectedDevice, pusher: Pusher) -> AbbSimpleArm:
    url = f"tcp://127.0.0.1:{device.port}?state={pusher.port}"
    return AbbSimpleArm(url, speed_mm_s=1e6, speed_deg_s=90.0)


def test_driver_speaks_simple_message() -> None:
    with Pusher(AT_HERE) as pusher, ExpectedDevice(moving(pusher)) as device:
        arm = arm_at(device, pusher)
        arm.connect()
        arm.arm()
        reached = arm.move_to(TARGET)
        arm.stop()
        arm.disconnect()
    assert reached.joints_deg == pytest.approx(TARGET, abs=1e-5)
    assert reached.raw == AT_THERE
    assert reached.resolution_deg == math.degrees(2.0**-23)


def test_driver_refused_by_the_controller() -> None:
    with Pusher(AT_HERE) as pusher, ExpectedDevice([(HALT, TAKEN), (FIRST, FAILED)]) as device:
        arm = arm_at(device, pusher)
        arm.connect()
        arm.arm()
        with pytest.raises(CommandRefused):
            arm.move_to(TARGET)
        arm.disconnect()


def test_driver_of_an_abb_driver_without_status() -> None:
    with Pusher(AT_HERE[:60]) as pusher:
        arm = AbbSimpleArm(f"tcp://127.0.0.1:1?state={pusher.port}")
        with pytest.raises(ProtocolError, match="too old"):
            arm.connect()


def test_simulator() -> None:
    with CellThread(FAST, devices=("abb-simple",)) as cell:
        assert pushed(cell, AT_HERE)
        converse(cell.port("abb-simple"), MOVE[:3])
        assert pushed(cell, AT_THERE)
        converse(cell.port("abb-simple"), MOVE[3:])
        assert cell.cell is not None
        assert cell.cell.arm.joints_deg() == pytest.approx(TARGET, abs=1e-5)


def pushed(cell: CellThread, state: bytes) -> bool:
    """Report whether the simulator pushes exactly this state at some time."""
    with socket.create_connection(("127.0.0.1", cell.port("abb-simple-state")), timeout=PATIENCE_S) as client:
        got = b""
        while state not in got and len(got) < 1000 * len(state):
            got += client.recv(4096)
    return state in got


def test_external_axes_are_told_to_stay_where_three_states_say_they_are() -> None:
    """One state in six has one wrong bit of an external axis, and is never sent back."""
    wrong = AT_HERE[:44] + bytes([AT_HERE[44] ^ 0x40]) + AT_HERE[45:]
    with Pusher(wrong + 5 * AT_HERE) as pusher, ExpectedDevice(moving(pusher)) as device:
        arm = arm_at(device, pusher)
        arm.connect()
        arm.arm()
        arm.move_to(TARGET)
        arm.stop()
        arm.disconnect()


def with_a_byte(state: bytes, at: int, byte: int) -> bytes:
    return state[:at] + bytes([byte]) + state[at + 1 :]


def test_two_damaged_states_in_a_row_that_agree_are_not_where_the_robot_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two corrupted states read joint 2 as -1e-8 deg and -2e-18 deg; to the driver, both are 0.

    Each is -45 deg without one of two bits of its exponent.
    """
    top_of_joint_2 = 20 + 4 + 3
    damaged = [with_a_byte(AT_THERE, top_of_joint_2, byte) for byte in (0xAF, 0x9F)]
    assert max(abs(parse_state(each).joints_deg[1]) for each in damaged) < 0.002
    arm = AbbSimpleArm("tcp://127.0.0.1:1")
    monkeypatch.setattr(arm, "_stream", Told([*damaged, *3 * [AT_THERE]]))
    assert arm.position().joints_deg == pytest.approx(TARGET, abs=1e-5)
