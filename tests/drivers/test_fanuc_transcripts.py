"""Golden conversations with a Fanuc, played with the driver and with the simulator.

MAPPDK requests are as fanucpy writes them (`movej` has four fields of fixed width and values of 14 characters). Answers
are as its KAREL server writes them (CNV_REAL_STR(x, 8, 3), `none` for missing axes); the checksums of our own answers
come from `od` and `awk`. Modbus frames are written by hand from the Modbus TCP specification; 10.5 deg is the float
4128 0000, -20.25 deg c1a2 0000, sent low word first.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import pytest

from drivers import CannotStop, FanucArm, FanucDeadlines, JointLimit, LinkError, ProtocolError
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.drivers.expected import ExpectedDevice, Pair, converse

FAST = CellFile(robot="fanuc-lrmate200ic", time_scale=10_000.0, effects=("none",))
QUICK = FanucDeadlines(gap_s=0.001)
TARGET = (10.5, -20.25, 0.0, 0.0, 0.0, 90.0)

NONES = b",j=none,j=none,j=none"
ZERO = b"0:j=   0.000,j=   0.000,j=   0.000,j=   0.000,j=   0.000,j=   0.000" + NONES
THERE = b"0:j=  10.500,j= -20.250,j=   0.000,j=   0.000,j=   0.000,j=  90.000" + NONES
POSE = b"0:x= 475.000,y=   0.000,z= 375.000,w= 180.000,p= -90.000,r=   0.000"
MOVE = (
    b"movej:0002:0100:000:0:6:+000010.500000:-000020.250000:+000000.000000:+000000.000000:+000000.000000"
    b":+000090.000000\n"
)


def asked(request: bytes, answer: bytes) -> list[Pair]:
    """A question of the driver, and `curpos` behind it."""
    return [(request, answer), (b"curpos\n", POSE)]


GREETED: list[Pair] = [(b"", b"0:success")]
HERE, ARRIVED = asked(b"curjpos\n", ZERO), asked(b"curjpos\n", THERE)
MAPPDK_MAIN = GREETED + 2 * HERE + 2 * HERE + asked(MOVE, b"0:success") + 2 * ARRIVED
SET = b"calset:0004:0002" + MOVE[23:]
SHOWN = (
    b"0:c=0004,v=0002,j=     10.500000,j=    -20.250000,j=      0.000000,j=      0.000000,j=      0.000000"
    b",j=     90.000000,k=674;"
)
MAPPDK_OUR_MAIN = (
    GREETED
    + 2 * HERE
    + 2 * HERE
    + asked(SET, SHOWN)
    + asked(b"calgo:0005:506\n", b"0:c=0005,r=0,k=730;")
    + 2 * ARRIVED
)
MAPPDK_STOCK_LOGGER = GREETED + asked(b"calname:0001\n", b"1:wrong-command") + HERE
MAPPDK_OUR_LOGGER = (
    GREETED
    + asked(b"calname:0001\n", b"0:c=0001,v=2,LR Mate 200iC,V7.70P,k=121;")
    + asked(b"calstat:0002\n", b"0:c=0002,a=1,p=1,e=0,m=0,n=00000,k=948;")
    + asked(b"calbeat:0003:02000\n", b"0:c=0003,w=02000,k=927;")
    + asked(b"calstop:0006\n", b"0:c=0006,k=464;")
)
FANUCPY: list[Pair] = [
    *GREETED,
    (b"curjpos\n", ZERO),
    (b"movej:0025:0100:050:1" + MOVE[21:], b"0:success"),
    (b"curjpos\n", THERE),
    (b"nonsense\n", b"1:wrong-command"),
    (b"movej:0025:0100:000:0:6:+000000.000000:+000000.000000:-000143.000000" + 3 * b":+000000.000000" + b"\n",
     b"1:position-is-not-reachable"),
    (b"exit\n", b"0:success"),
]  # fmt: skip


def pose_only_place(reply: bytes) -> bytes:
    """Remove w, p, r from a reply: at p = -90 deg the other two turn about the same axis."""
    return re.sub(rb",w=.*", b"", reply)


def between(main: ExpectedDevice, logger: ExpectedDevice) -> FanucArm:
    return FanucArm(f"tcp://127.0.0.1:{main.port}?logger={logger.port}", deadlines=QUICK)


@pytest.mark.parametrize("ours", [False, True])
def test_driver_speaks_mappdk(ours: bool) -> None:
    front, behind = (MAPPDK_OUR_MAIN, MAPPDK_OUR_LOGGER) if ours else (MAPPDK_MAIN, MAPPDK_STOCK_LOGGER)
    with ExpectedDevice(front) as main, ExpectedDevice(behind) as logger:
        arm = between(main, logger)
        arm.connect()
        assert arm.can_stop == ours
        arm.arm()
        reached = arm.move_to(TARGET)
        assert (reached.joints_deg, reached.resolution_deg, reached.raw) == (TARGET, 0.001, THERE)
        if ours:
            arm.stop()
        else:
            with pytest.raises(CannotStop):
                arm.stop()
        arm.disconnect()


def test_stock_simulator_speaks_to_fanucpy() -> None:
    with CellThread(FAST, stock=True, devices=("fanuc",)) as cell:
        converse(cell.port("fanuc"), FANUCPY[:4], same=pose_only_place)
        converse(cell.port("fanuc"), [FANUCPY[0], *FANUCPY[4:]])


@pytest.mark.parametrize("stock", [True, False])
def test_simulator_serves_the_drivers_conversation(stock: bool) -> None:
    with CellThread(FAST, stock=stock, devices=("fanuc",)) as cell:
        front, behind = (MAPPDK_MAIN, MAPPDK_STOCK_LOGGER) if stock else (MAPPDK_OUR_MAIN, MAPPDK_OUR_LOGGER)
        converse(cell.port("fanuc-logger"), behind, pose_only_place)
        converse(cell.port("fanuc"), [pair for pair in front if b"curpos" not in pair[0]])


def refuses_to_move(
    front: Sequence[Pair], behind: Sequence[Pair], error: type[Exception], match: str
) -> None:
    with ExpectedDevice(front) as main, ExpectedDevice(behind) as logger:
        arm = between(main, logger)
        arm.connect()
        arm.arm()
        with pytest.raises(error, match=match):
            arm.move_to(TARGET)
        arm.disconnect()


def test_driver_names_what_a_mappdk_server_refuses() -> None:
    refused = MAPPDK_MAIN[:9] + asked(MOVE, b"1:position-is-not-reachable")
    refuses_to_move(refused, MAPPDK_STOCK_LOGGER, JointLimit, "not reachable")


@pytest.mark.parametrize(
    ("name", "match"),
    [
        (b"0:c=0001,v=1,LR Mate 200iC,V7.70P,k=120;", "program version 1, needed 2"),
        (b"0:c=0001,v=1,LR Mate 300iC,V7.70P,k=120;", "wrong sum"),
    ],
)
def test_another_version_of_our_server_or_a_spoiled_answer_is_refused(name: bytes, match: str) -> None:
    answers = GREETED + asked(b"calname:0001\n", name)
    with ExpectedDevice(GREETED) as main, ExpectedDevice(answers) as logger:
        arm = between(main, logger)
        with pytest.raises(ProtocolError, match=match):
            arm.connect()


@pytest.mark.parametrize("options", ["", "?modbus=hmi", "?modbus=io"])
def test_another_device_at_the_address(options: str) -> None:
    """An open_abb controller never greets and has no Modbus; a FARO bridge answers in lines."""
    hasty = replace(QUICK, connect_s=0.3, reply_s=0.3)
    with CellThread(replace(FAST, robot="abb-irb120")) as cell:
        for device in ("abb", "faro"):
            arm = FanucArm(cell.url(device) + options, deadlines=hasty)
            with pytest.raises(LinkError):
                arm.connect()


# -- Modbus --------------------------------------------------------------------------------------------------


class Frames:
    """Frames of one connection; the transaction number counts up from 1."""

    def __init__(self) -> None:
        self.pairs: list[Pair] = []

    def _pair(self, request: str, answer: str) -> None:
        head = bytes([0, len(self.pairs) + 1, 0, 0])
        bodies = (bytes.fromhex(request), bytes.fromhex(answer))
        sent, got = (head + bytes([0, len(body) + 1, 1]) + body for body in bodies)
        self.pairs.append((sent, got))

    def read(self, address: str, words: str) -> None:
        """Function 03: address and words in hexadecimal."""
        count = len(bytes.fromhex(words)) // 2
        self._pair(f"03 {address} {count:04x}", f"03 {2 * count:02x} {words}")

    def poke(self, address: str, words: str) -> None:
        """Function 10 (hexadecimal)."""
        count = len(bytes.fromhex(words)) // 2
        self._pair(f"10 {address} {count:04x} {2 * count:02x} {words}", f"10 {address} {count:04x}")

    def write(self, address: str, words: str) -> None:
        """Written, and read back."""
        self.poke(address, words)
        self.read(address, words)


TARGET_HMI = "0000 4128  0000 c1a2  0000 0000  0000 0000  0000 0000  0000 42b4" + 6 * " 0000" + " 0001"
HERE_HMI = 18 * "0000 " + "0001"


def hmi_conversation() -> list[Pair]:
    def view(number: int, done: int) -> str:
        registers = [2 if number else 0, number, 0, 0, done, 0, 0, 1 if number else 0]
        words = registers + [0] * 50
        words[10] = 2  # R[91]: version of CALHMI
        words[49] = 2  # PRG[1]: running
        return " ".join(f"{word:04x}" for word in words)

    frames = Frames()
    frames.read("0000", HERE_HMI)  # connect: two readings of POS[0] joints
    frames.read("0000", HERE_HMI)
    frames.read("003c", view(0, 0))  # arm: status, twice the progress, two readings
    frames.read("003c", view(0, 0))
    frames.read("003c", view(0, 0))
    frames.read("0000", HERE_HMI)
    frames.read("0000", HERE_HMI)
    frames.poke("0043", "0001")  # R[88] beat
    frames.write("0014", TARGET_HMI)  # PR[81]
    frames.write("0042", "0000")  # R[87] stop
    frames.write("003c", "0002 0001")  # R[81] speed, R[82] number
    frames.poke("003e", "03e9")  # R[83] go: 1000 and the number
    frames.read("003c", view(1, 1))
    frames.read("003c", view(1, 1))
    frames.read("0000", TARGET_HMI)
    frames.read("0000", TARGET_HMI)
    frames.poke("0042", "0001")  # stop
    return frames.pairs


TARGET_IO = "9a28 0001  e8fc fffc  0000 0000  0000 0000  0000 0000  bba0 000d"  # 105000, -202500, 900000
HERE_IO = 12 * " 0000"
SUM_IO, VERSION_IO = "14d1", " 0002"  # 7919, then for every word times 31 plus the word, modulo 65521


def io_conversation() -> list[Pair]:
    ready, done = "0028 0000 0000", "012a 0000 0002"  # fit and running; done and number 1
    frames = Frames()

    def stands_still(order: str, state: str) -> None:
        """Twice the order in force and the state, then two readings of the joints."""
        for _ in range(2):
            frames.read("0000", order)
            frames.read("0064", state + VERSION_IO)
        frames.read("0064", state + VERSION_IO)
        frames.read("0064", state + VERSION_IO)

    frames.read("0064", ready + HERE_IO + VERSION_IO)
    frames.read("0064", ready + HERE_IO + VERSION_IO)
    frames.read("0064", ready + HERE_IO + VERSION_IO)  # arm: status
    stands_still("0000", ready + HERE_IO)
    frames.poke("0002", "0001")  # beat
    frames.write("0000", "0100")  # number
    frames.write("0001", "0002")  # speed
    frames.write("0003", f"{TARGET_IO} {SUM_IO}")
    frames.write("0000", "0101")  # go
    stands_still("0101", done + TARGET_IO)
    frames.poke("0000", "0102")  # stop
    return frames.pairs


CONVERSATIONS = {"hmi": hmi_conversation(), "io": io_conversation()}


@pytest.mark.parametrize("profile", list(CONVERSATIONS))
def test_driver_speaks_modbus(profile: str) -> None:
    with ExpectedDevice(CONVERSATIONS[profile]) as device:
        arm = FanucArm(f"tcp://127.0.0.1:{device.port}?modbus={profile}", deadlines=QUICK)
        arm.connect()
        arm.arm()
        assert arm.move_to(TARGET).joints_deg == pytest.approx(TARGET, abs=1e-9)
        arm.stop()
        arm.disconnect()


@pytest.mark.parametrize("profile", list(CONVERSATIONS))
def test_simulator_speaks_modbus(profile: str) -> None:
    """All but the views right after `go`, which depend on when they are taken."""
    pairs = CONVERSATIONS[profile]
    go = next(i for i, (request, _) in enumerate(pairs) if request[7:] in GO)
    with CellThread(FAST, devices=("fanuc",)) as cell:
        converse(cell.port(f"fanuc-modbus-{profile}"), pairs[: go + 1])


GO = (bytes.fromhex("10 003e 0001 02 03e9"), bytes.fromhex("10 0000 0001 02 0101"))


def test_modbus_simulator_refuses_what_it_does_not_know() -> None:
    pairs = [
        (bytes.fromhex("0001 0000 0002 01 2b"), bytes.fromhex("0001 0000 0003 01 ab 01")),
        (bytes.fromhex("0002 0000 0006 ff 03 0000 007e"), bytes.fromhex("0002 0000 0003 ff 83 03")),
        (bytes.fromhex("0003 0000 0006 ff 01 0000 0009"), bytes.fromhex("0003 0000 0005 ff 01 02 0000")),
        (bytes.fromhex("0004 0000 0006 01 06 0190 0007"), bytes.fromhex("0004 0000 0006 01 06 0190 0007")),
        (bytes.fromhex("0005 0000 0006 01 03 0190 0001"), bytes.fromhex("0005 0000 0005 01 03 02 0000")),
    ]
    with CellThread(FAST, devices=("fanuc",)) as cell:
        converse(cell.port("fanuc-modbus-hmi"), pairs)


@pytest.mark.parametrize(
    ("old", "new"), [(b"j=     90.000000,k=674", b"j=     91.000000,k=675"), (b"v=0002", b"v=0012")]
)
def test_nothing_goes_when_our_server_shows_another_target(old: bytes, new: bytes) -> None:
    shown = SHOWN.replace(old, new)
    if b"v=0012" in new:
        shown = shown.replace(b"k=674", b"k=675")
    assert shown != SHOWN
    front = GREETED + 2 * HERE + 2 * HERE + asked(SET, shown)
    refuses_to_move(front, MAPPDK_OUR_LOGGER[:-2], ProtocolError, "understood another request; nothing moved")


def test_our_simulator_goes_by_the_sum_of_its_target_once() -> None:
    pairs = [
        *GREETED,
        (b"movej:0025:0100:050:1" + MOVE[21:], b"1:wrong-command"),  # nothing moves on one request
        (b"calgo:0001:506\n", b"0:c=0001,r=5,k=731;"),  # no target was shown
        (SET, SHOWN),
        (b"calgo:0002:507\n", b"0:c=0002,r=5,k=732;"),  # not its sum
        (b"calgo:0003:506\n", b"0:c=0003,r=5,k=733;"),  # it was given up with that
        (SET, SHOWN),
        (b"calgo:0005:506\n", b"0:c=0005,r=0,k=730;"),
        (b"calgo:0006:506\n", b"0:c=0006,r=5,k=736;"),
    ]
    with CellThread(FAST, devices=("fanuc",)) as cell:
        converse(cell.port("fanuc"), pairs)


@pytest.mark.parametrize(("word", "bad"), [(1, "0003"), (3, "9a29"), (15, "0000")])
def test_signals_that_do_not_sum_up_move_nothing(word: int, bad: str) -> None:
    """Speed, joint and sum, each as one damaged write leaves it behind."""
    frames = Frames()
    frames.poke("0003", f"{TARGET_IO} {SUM_IO}")
    frames.poke("0001", "0002")
    frames.poke(f"{word:04x}", bad)
    frames.poke("0000", "0101")
    frames.read("0064", "012c 0005")
    with CellThread(FAST, devices=("fanuc",)) as cell:
        converse(cell.port("fanuc-modbus-io"), frames.pairs)
        assert cell.cell is not None
        assert cell.cell.arm.sent_to == []


def test_registers_go_by_the_number_of_the_command() -> None:
    frames = Frames()
    frames.poke("0014", TARGET_HMI)
    frames.poke("003c", "0002 0001")
    for go in ("0001", "0002", "03ea"):
        frames.poke("003e", go)
    frames.read("0040", "0001 0005")
    with CellThread(FAST, devices=("fanuc",)) as cell:
        converse(cell.port("fanuc-modbus-hmi"), frames.pairs)
        assert cell.cell is not None
        assert cell.cell.arm.sent_to == []
