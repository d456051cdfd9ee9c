"""Golden conversations of RTDE and URScript, byte for byte, with driver and simulator.

Written by hand from the maker's guide: lengths, types and numbers are literal, so that neither codec can be wrong
together with them.
"""

from __future__ import annotations

import socket
import struct

import pytest

from drivers import ProtocolError, UrArm
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.drivers.expected import ExpectedDevice, Pair, converse
from tests.drivers.waiting import PATIENCE_S, until

FAST = CellFile(robot="ur5", time_scale=5000.0, effects=("none",))

NAMES = b"timestamp,target_q,actual_q,target_qd,actual_qd,robot_mode,safety_mode,runtime_state"
TYPES = b"DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,INT32,INT32,UINT32"
DOUBLES = b"".join(b",output_double_register_%d" % i for i in range(24, 34))
START = (b"\x00\x03S", b"\x00\x04S\x01")
PAUSE = (b"\x00\x03P", b"\x00\x04P\x01")
OPENING: list[Pair] = [
    (b"\x00\x05V\x00\x02", b"\x00\x04V\x01"),
    (b"\x00\x03v", b"\x00\x13v\x00\x00\x00\x03\x00\x00\x00\x0f\x00\x00\x00\x08\x00\x01\x9f\x63"),
    (
        b"\x01\x7aO\x40\x5f\x40\x00\x00\x00\x00\x00" + NAMES + b",output_int_register_46" + DOUBLES,
        b"\x00\x8dO\x01" + TYPES + b",INT32" + 10 * b",DOUBLE",
    ),
]
CLAIM: Pair = (b"\x00\x2eIinput_int_register_46,input_int_register_47", b"\x00\x0fI\x01INT32,INT32")
BEAT = b"\x00\x0cU\x01\x00\x00\x00\x01\x00\x00\x00\x00"
GO = b"\x00\x0cU\x01\x00\x00\x00\x02\x00\x00\x00\x06"
PROGRAM = (
    b"def truepose():\n"
    b"  goal = [0.50000000, 0.00000000, 0.00000000, 0.00000000, 0.00000000, -0.25000000]\n"
    b"  gain = 1.047198\n"
    b"  pace = 0.349066\n"
    b"  zero = 0.0\n"
    b"  guard = 0.500\n"
    b"  number = 6\n"
    b'  rtde_set_watchdog("input_int_register_46", guard, "stop")\n'
    b"  write_output_float_register(24, goal[0])\n"
    b"  write_output_float_register(25, goal[1])\n"
    b"  write_output_float_register(26, goal[2])\n"
    b"  write_output_float_register(27, goal[3])\n"
    b"  write_output_float_register(28, goal[4])\n"
    b"  write_output_float_register(29, goal[5])\n"
    b"  write_output_float_register(30, gain)\n"
    b"  write_output_float_register(31, pace)\n"
    b"  write_output_float_register(32, zero)\n"
    b"  write_output_float_register(33, guard)\n"
    b"  write_output_integer_register(46, number)\n"
    b"  while read_input_integer_register(47) != number:\n"
    b"    sync()\n"
    b"  end\n"
    b"  movej(goal, gain, pace, zero, zero)\n"
    b"end\n"
)
PLAIN_PROGRAM = (
    b"def truepose():\n"
    b"  movej([0.50000000, 0.00000000, 0.00000000, 0.00000000, 0.00000000, -0.25000000], "
    b"a=1.047198, v=0.349066)\n"
    b"end\n"
)
HALF_RAD, QUARTER_RAD = b"\x3f\xe0\0\0\0\0\0\0", b"\xbf\xd0\0\0\0\0\0\0"
ZERO = bytes(8)
HOME = ZERO * 6
GOAL = HALF_RAD + ZERO * 4 + QUARTER_RAD
ARGUMENTS = GOAL + struct.pack(">dd", 1.047198, 0.349066) + ZERO + HALF_RAD  # half a beat a second


def data(
    second: int, joints: bytes, speed: bytes, runtime: int, echo: int, registers: bytes = 10 * ZERO
) -> bytes:
    """Return a data package of recipe 1 with 300 bytes, mode running and safety normal.

    `second` is at most 8.
    """
    t = (
        b"\x3f\xf0",
        b"\x40\x00",
        b"\x40\x08",
        b"\x40\x10",
        b"\x40\x14",
        b"\x40\x18",
        b"\x40\x1c",
        b"\x40\x20",
    )[second - 1]
    modes = b"\0\0\0\x07\0\0\0\x01" + b"\0\0\0" + bytes([runtime]) + b"\0\0\0" + bytes([echo])
    return b"\x01\x2cU\x01" + t + bytes(6) + joints * 2 + speed * 2 + modes + registers


AT_HOME = data(1, HOME, HOME, 1, 5) + data(2, HOME, HOME, 1, 5)
SPEED = b"\x3f\xd6\0\0\0\0\0\0" + ZERO * 4 + b"\xbf\xc6\0\0\0\0\0\0"
BEGUN = data(3, HOME, HOME, 2, 6, ARGUMENTS) + data(4, HOME, HOME, 2, 6, ARGUMENTS)
ON_THE_WAY = data(5, HOME, SPEED, 2, 6, ARGUMENTS) + data(6, HOME, SPEED, 2, 6, ARGUMENTS)
ARRIVED = data(7, GOAL, HOME, 1, 6, ARGUMENTS) + data(8, GOAL, HOME, 1, 6, ARGUMENTS)
LOOK: list[Pair] = [(START[0], START[1] + AT_HOME), PAUSE]


def packet(t: int, joints: bytes, speed: bytes = HOME, program: bytes = b"\x3f\xf0") -> bytes:
    """Return a packet of port 30003, software 3.14, with 1140 bytes.

    Its modes are running and normal, and it has the state of the program.
    """
    body = bytearray(1140)
    body[0:4] = b"\x00\x00\x04\x74"
    body[4:12] = struct.pack(">d", t)
    body[12:60] = body[252:300] = joints
    body[60:108] = body[300:348] = speed
    body[756:764] = b"\x40\x1c" + bytes(6)  # 7
    body[812:820] = b"\x3f\xf0" + bytes(6)  # 1
    body[1052:1060] = program + bytes(6)
    return bytes(body)


ARRIVED_PACKETS = [packet(t, GOAL) for t in (5, 6)]


def test_driver_speaks_rtde_and_urscript() -> None:
    rtde = [
        *OPENING,
        *LOOK,  # connect reads the joints
        CLAIM,
        *LOOK,  # arm looks at the modes
        (START[0], START[1] + AT_HOME),
        (BEAT, BEGUN),
        (GO, ON_THE_WAY + ARRIVED),
        PAUSE,
    ]
    script: list[Pair] = [(b"", packet(1, HOME)), (PROGRAM, b"")]
    stop: list[Pair] = [(b"", packet(1, GOAL)), (b"stopj(4)\n", packet(2, GOAL) + packet(3, GOAL))]
    with ExpectedDevice(rtde) as device, ExpectedDevice(script, stop) as realtime:
        arm = UrArm(
            f"tcp://127.0.0.1:{device.port}?realtime={realtime.port}",
            clock=lambda: 0.0,  # one beat of the watchdog, however slow this machine is
        )
        arm.connect()
        arm.arm()
        reached = arm.move_to((28.64788975654116, 0, 0, 0, 0, -14.32394487827058))
        assert reached.joints_deg == pytest.approx((28.64788975654116, 0, 0, 0, 0, -14.32394487827058))
        arm.stop()
        arm.disconnect()


def test_driver_without_rtde_speaks_urscript() -> None:
    """Every request has a separate connection: two to connect, one to arm.

    The move's states and its program have one each.
    """
    program = PLAIN_PROGRAM
    idle: list[Pair] = [(b"", packet(1, HOME) + packet(2, HOME))]
    moving = [packet(t, HOME, SPEED, b"\x40\x00") for t in (3, 4)]
    follow: list[Pair] = [(b"", b"".join([packet(1, HOME), packet(2, HOME), *moving, *ARRIVED_PACKETS]))]
    script: list[Pair] = [(b"", packet(1, HOME)), (program, b"")]
    with ExpectedDevice(idle, idle, idle, follow) as states, ExpectedDevice(script) as programs:
        arm = UrArm(f"tcp://127.0.0.1:30004?feed=realtime&realtime={states.port}")
        arm.connect()
        arm.arm()
        talk = UrArm(f"tcp://127.0.0.1:30004?realtime={programs.port}")._ports[0].talk
        arm._ports[0].talk = talk
        reached = arm.move_to((28.64788975654116, 0, 0, 0, 0, -14.32394487827058))
        assert reached.joints_deg == pytest.approx((28.64788975654116, 0, 0, 0, 0, -14.32394487827058))
        arm.disconnect()


def test_simulator_speaks_rtde() -> None:
    """Everything that does not depend on time, byte for byte; then a stream, package by package."""
    with CellThread(FAST, devices=("ur",)) as cell:
        converse(cell.port("ur"), [*OPENING, PAUSE, CLAIM, PAUSE])
        with socket.create_connection(("127.0.0.1", cell.port("ur")), timeout=PATIENCE_S) as client:
            for request, _ in OPENING:
                client.sendall(request)
                read_package(client)
            client.sendall(START[0])
            assert read_package(client) == START[1]
            first, second = read_package(client), read_package(client)
            client.sendall(PAUSE[0])
            while (last := read_package(client))[2:3] == b"U":
                assert timeless(last) == timeless(first)
            assert last == PAUSE[1]
    assert timeless(first) == timeless(second) == timeless(data(1, HOME, HOME, 1, 0))
    assert struct.unpack(">d", first[4:12]) < struct.unpack(">d", second[4:12])


def read_package(client: socket.socket) -> bytes:
    head = client.recv(3, socket.MSG_WAITALL)
    return head + client.recv(int.from_bytes(head[:2]) - 3, socket.MSG_WAITALL)


def timeless(package: bytes) -> bytes:
    return package[:4] + package[12:]


REFUSED: list[Pair] = [
    (b"\x00\x05V\x00\x09", b"\x00\x04V\x00"),
    (b"\x00\x05V\x00\x02", b"\x00\x04V\x01"),
    (b"\x00\x18O\x40\x5f\x40\x00\x00\x00\x00\x00timestamp,xyz", b"\x00\x14O\x00DOUBLE,NOT_FOUND"),
    (b"\x00\x06Ixyz", b"\x00\x0dI\x00NOT_FOUND"),
    (b"\x00\x03S", b"\x00\x04S\x00"),  # nothing set up: nothing to start
    (b"\x00\x03x", b"\x00\x1dM\x13unknown package 'x'\x04RTDE\x01"),
]


def test_simulator_refuses_what_the_guide_refuses() -> None:
    with CellThread(FAST, devices=("ur",)) as cell:
        converse(cell.port("ur"), REFUSED)
        with socket.create_connection(("127.0.0.1", cell.port("ur")), timeout=PATIENCE_S) as first:
            first.sendall(CLAIM[0])
            assert read_package(first) == CLAIM[1]
            converse(cell.port("ur"), [(CLAIM[0], b"\x00\x11I\x00IN_USE,IN_USE")])


def test_simulator_runs_the_drivers_program_and_stops() -> None:
    with CellThread(FAST, devices=("ur",)) as cell:
        assert cell.cell is not None
        controller = cell.cell.ur
        with socket.create_connection(("127.0.0.1", cell.port("ur-realtime")), timeout=PATIENCE_S) as client:
            shown = client.recv(1140, socket.MSG_WAITALL)
            golden = packet(1, HOME)
            for first, last in ((0, 4), (12, 108), (252, 348), (756, 764), (812, 820), (1052, 1060)):
                assert shown[first:last] == golden[first:last]
            client.sendall(PROGRAM)
            until(lambda: controller.registers.integers.get(46) == 6)
            assert [controller.registers.doubles[i] for i in (24, 29, 30, 31)] == [
                0.5,
                -0.25,
                1.047198,
                0.349066,
            ]
            assert cell.do("state")["joints_deg"] == (0.0,) * 6  # it waits for its number
            with socket.create_connection(("127.0.0.1", cell.port("ur")), timeout=PATIENCE_S) as rtde:
                for request, _ in (OPENING[0], CLAIM):
                    rtde.sendall(request)
                    read_package(rtde)
                rtde.sendall(GO)
                until(lambda: cell.do("state")["joints_deg"][0] == pytest.approx(28.6478898))
            client.sendall(b"stopj(4)\nnonsense(1)\ndef f():\n  movej([0,0,0,0,0],v=0.5)\n  popup(1)\nend\n")
            until(lambda: len(cell.do("ur_refused")["refused"]) == 2)
        assert cell.cell.ur.registers.integers[46] == 6
        assert cell.do("state")["joints_deg"] == pytest.approx((28.6478898, 0, 0, 0, 0, -14.3239449))


def test_simulator_dashboard() -> None:
    with CellThread(FAST, devices=("ur",)) as cell:
        converse(
            cell.port("ur-dashboard"),
            [
                (b"", b"Connected: Universal Robots Dashboard Server\n"),
                (b"get serial number\n", b"20155301234\n"),
                (b"get robot model\n", b"UR5\n"),
                (b"dance\n", b"could not understand: 'dance'\n"),
            ],
        )


@pytest.mark.parametrize("place", range(10))
def test_nothing_goes_when_the_program_tells_something_else(place: int) -> None:
    """One of its numbers is another: target, acceleration, speed, the zeros, or the watchdog."""
    other = ARGUMENTS[: 8 * place] + struct.pack(">d", 1.25) + ARGUMENTS[8 * place + 8 :]
    begun = [data(second, HOME, HOME, 2, 6, other) for second in (3, 4)]
    rtde = [*OPENING, *LOOK, CLAIM, *LOOK, (START[0], START[1] + AT_HOME), (BEAT, b"".join(begun)), PAUSE]
    script: list[Pair] = [(b"", packet(1, HOME)), (PROGRAM, b"")]
    stop: list[Pair] = [(b"", packet(1, HOME)), (b"stopj(4)\n", packet(2, HOME) + packet(3, HOME))]
    with ExpectedDevice(rtde) as device, ExpectedDevice(script, stop) as realtime:
        arm = UrArm(f"tcp://127.0.0.1:{device.port}?realtime={realtime.port}", clock=lambda: 0.0)
        arm.connect()
        arm.arm()
        with pytest.raises(ProtocolError, match="another program arrived"):
            arm.move_to((28.64788975654116, 0, 0, 0, 0, -14.32394487827058))
        arm.disconnect()
