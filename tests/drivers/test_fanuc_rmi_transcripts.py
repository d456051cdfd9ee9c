"""Test the driver and the simulator of RMI with conversations written by hand.

Spaces and the order of members are those of a controller, as its owners published them in
FANUC-CORPORATION/fanuc_driver, issue 14, vertec-io/Fanuc_RMI_API and brechtBDCK/Fanuc_RMI.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

import pytest

from drivers import FanucDeadlines, LinkError, ProtocolError, open_robot
from mocks.cell import CellThread
from tests.drivers.expected import ExpectedDevice, Pair, converse
from tests.drivers.fanuc_cells import FAST, SLOW
from tests.drivers.waiting import PATIENCE_S, until

WAITS = FanucDeadlines(gap_s=0.001, takeover_s=0.0, reply_s=5.0)
CONNECT = b'{"Communication": "FRC_Connect"}\r\n'
_VERSION = b'"MajorVersion" : 9, "MinorVersion" : 0'
ACCEPTED = b'{"Communication" : "FRC_Connect", "ErrorID" : 0, "PortNumber" : 16002, %s}\r\n' % _VERSION
GET_STATUS, READ = b'{"Command": "FRC_GetStatus"}\r\n', b'{"Command": "FRC_ReadJointAngles"}\r\n'


def status(*, running: int = 0, number: int = 1) -> Pair:
    return GET_STATUS, (
        b'{"Command" : "FRC_GetStatus", "ErrorID" : 0, "ServoReady" : 1, "TPMode" : 0, "RMIMotionStatus" : %d, '
        b'"ProgramStatus" : 0, "SingleStepMode" : 0, "NumberUTool" : 10, "NextSequenceID" : %d, "NumberUFrame" : 9, '
        b'"Override" : 100}\r\n' % (running, number)
    )


def joints(tag: int, text: bytes = b'"J1" : 0.0, "J2" : 0.0, "J3" : 0.0') -> Pair:
    return READ, (
        b'{"Command" : "FRC_ReadJointAngles", "ErrorID" : 0, "TimeTag" : %d, "JointAngle" : {%s, "J4" : 0.0, '
        b'"J5" : 0.0, "J6" : 0.0, "J7" : 0.0, "J8" : 0.0, "J9" : 0.0}, "Group" : 1}\r\n' % (tag, text)
    )


MOVED = b'"J1" : 10.123, "J2" : -5.0, "J3" : 0.5'
CONNECTED = [status(), joints(1), status(), joints(2), status(), joints(3)]
ARMED = [
    *(status(), joints(4), status()),  # may it move
    *(joints(5), status(), joints(6), status()),  # does RMI run
    (
        b'{"Command": "FRC_Initialize"}\r\n',
        b'{"Command" : "FRC_Initialize", "ErrorID" : 0, "GroupMask" : 1}\r\n',
    ),
    *(status(running=1), joints(7), status(running=1)),
    *(joints(8), status(running=1), joints(9)),
]
MOTION: list[Pair] = [
    (status(running=1)[0], status(running=1)[1]),
    joints(10),
    (
        b'{"Instruction": "FRC_JointMotionJRep", "SequenceID": 1, "JointAngle": {"J1": 10.1234, "J2": -5.0, '
        b'"J3": 0.5, "J4": 0.0, "J5": 0.0, "J6": 0.0}, "SpeedType": "Percent", "Speed": 5, "TermType": "FINE", '
        b'"TermValue": 0}\r\n' + GET_STATUS,
        b'{"Instruction" : "FRC_JointMotionJRep", "ErrorID" : 0, "SequenceID" : 1}\r\n'
        + status(running=1)[1],
    ),
    *(joints(11, MOVED), status(running=1)),
    *(joints(12, MOVED), status(running=1), joints(13, MOVED)),
]
LEFT = [
    (b'{"Command": "FRC_Abort"}\r\n', b'{"Command" : "FRC_Abort", "ErrorID" : 0}\r\n'),
    (b'{"Communication": "FRC_Disconnect"}\r\n', b'{"Communication" : "FRC_Disconnect", "ErrorID" : 0}\r\n'),
]


def arm_at(stack: ExitStack, door: Sequence[Pair], session: Sequence[Pair] = ()) -> Any:
    devices = [stack.enter_context(ExpectedDevice(pairs)) for pairs in (door, session) if pairs]
    ports = [device.port for device in devices]
    arm = open_robot(
        "fanuc-rmi", f"tcp://127.0.0.1:{ports[0]}?session={ports[-1]}", deadlines=WAITS, speed_deg_s=20.0
    )
    stack.callback(arm.disconnect)
    return arm


def test_a_whole_conversation() -> None:
    with ExitStack() as stack:
        arm = arm_at(stack, [(CONNECT, ACCEPTED)], [*CONNECTED, *ARMED, *MOTION, *LEFT])
        arm.connect()
        arm.arm()
        assert arm.move_to((10.12341, -5.0, 0.5, 0.0, 0.0, 0.0)).joints_deg[:3] == (10.123, -5.0, 0.5)
        arm.disconnect()


@pytest.mark.parametrize(
    "answer",
    [
        ACCEPTED.replace(b'"PortNumber" : 16002, ', b""),
        ACCEPTED.replace(b"16002", b"160020"),
        ACCEPTED.replace(b"16002", b'"16002"'),
        ACCEPTED.replace(b"9,", b"true,"),
        ACCEPTED.replace(b"FRC_Connect", b"FRC_Connect_STMO"),
        b"[1]\r\n",
        b"0:success\r\n",
        b"[" * 4000 + b"\r\n",
        b'{"Command" : "Unknown", "ErrorID" : 2556941} \r\n',
    ],
)
def test_what_is_no_session(answer: bytes) -> None:
    with ExitStack() as stack:
        arm = arm_at(stack, [(CONNECT, answer)])
        with pytest.raises(ProtocolError) as caught:
            arm.connect()
        assert (caught.value.device, caught.value.command) == ("fanuc-rmi", "connect")
        assert caught.value.what_to_do


@pytest.mark.parametrize(
    "answer",
    [
        joints(1, b'"J1" : NaN, "J2" : 0.0, "J3" : 0.0')[1],
        joints(1, b'"J1" : 1e400, "J2" : 0.0, "J3" : 0.0')[1],
        joints(1, b'"J1" : 1000.5, "J2" : 0.0, "J3" : 0.0')[1],
        joints(1, b'"J1" : 0.0, "J2" : 0.0')[1],
        joints(1, b'"J1" : 0.0, "J2" : null, "J3" : 0.0')[1],
        joints(1)[1].replace(b'"TimeTag" : 1, ', b""),
        joints(1)[1].replace(b'"JointAngle" : {', b'"JointAngles" : {'),
        joints(1)[1].replace(b'"ErrorID" : 0, ', b""),
        status()[1],
        b'{"Command" : "FRC_ReadJointAngles", "ErrorID" : 0, "TimeTag" : 1, "JointAngle" : [0, 0, 0, 0, 0, 0]}\r\n',
    ],
)
def test_what_is_no_joint_reading(answer: bytes) -> None:
    with ExitStack() as stack:
        arm = arm_at(stack, [(CONNECT, ACCEPTED)], [*CONNECTED[:3], (READ, answer)])
        with pytest.raises(LinkError):
            arm.connect()


def test_the_simulator_answers_as_a_controller() -> None:
    """Names and values of members are compared, except the time of a reading."""

    def same(reply: bytes) -> bytes:
        lines = [json.loads(line) for line in reply.splitlines(keepends=True) if line.endswith(b"\n")]
        timeless = [each | dict.fromkeys({"TimeTag"} & set(each), 0) for each in lines]
        return json.dumps(timeless, sort_keys=True).encode()

    def pair(name: str, **answer: Any) -> Pair:
        packets = {"Command": name}, {"Command": name, "ErrorID": 0} | answer
        ask, wanted = (json.dumps(packet).encode() + b"\r\n" for packet in packets)
        return ask, wanted

    initialize = pair("FRC_Initialize", GroupMask=1)
    motion = MOTION[2][0].removesuffix(GET_STATUS)

    def refused(error: int, number: int) -> bytes:
        return b'{"Instruction": "FRC_JointMotionJRep", "ErrorID": %d, "SequenceID": %d}\r\n' % (
            error,
            number,
        )

    def state(running: int, number: int, program: int) -> Pair:
        ask, answer = status(running=running, number=number)
        return ask, answer.replace(b'"ProgramStatus" : 0', b'"ProgramStatus" : %d' % program)

    with CellThread(FAST, devices=("fanuc-rmi",)) as cell:
        accepted = ACCEPTED.replace(b"16002", b"%d" % cell.port("fanuc-rmi-session"))
        converse(cell.port("fanuc-rmi"), [(CONNECT, accepted)], same)
        converse(
            cell.port("fanuc-rmi-session"),
            [
                state(0, 1, 2),
                joints(0),
                (motion, refused(2556937, 1)),  # RMIT-009
                pair("FRC_Abort", ErrorID=2556942),  # RMIT-014
                initialize,
                pair("FRC_Initialize", ErrorID=2556943),  # RMIT-015
                state(1, 1, 0),
                (motion, refused(0, 1)),
                joints(0, b'"J1" : 10.123, "J2" : -5.0, "J3" : 0.5'),
                (motion, refused(2556957, 1)),  # RMIT-029
                (motion.replace(b'"SequenceID": 1', b'"SequenceID": 2'), refused(2556952, 2)),  # RMIT-024
                pair("FRC_Reset"),
                state(1, 2, 0),
                (motion.replace(b'"SequenceID": 1', b'"SequenceID": 2'), refused(0, 2)),
                pair("FRC_ReadError", ErrorData="No Error"),
                (b"nonsense\r\n", b'{"Command": "Unknown", "ErrorID": 2556941}\r\n'),
                LEFT[1],
            ],
            same,
        )


def test_the_simulator_takes_eight_instructions_ahead_pauses_and_goes_on() -> None:
    with (
        CellThread(SLOW, devices=("fanuc-rmi",)) as cell,
        socket.create_connection(("127.0.0.1", cell.port("fanuc-rmi-session")), timeout=PATIENCE_S) as client,
        client.makefile("rwb") as lines,
    ):

        def ask(**packet: Any) -> Any:
            lines.write(json.dumps(packet).encode() + b"\r\n")
            lines.flush()
            return json.loads(lines.readline())

        ask(Command="FRC_Initialize")
        motion = json.loads(MOTION[2][0].removesuffix(GET_STATUS))
        for number in range(1, 9):
            lines.write(json.dumps(motion | {"SequenceID": number}).encode() + b"\r\n")
        assert ask(**motion | {"SequenceID": 9})["ErrorID"] == 2556956  # RMIT-028
        until(lambda: cell.do("state")["moving"])
        assert ask(Command="FRC_Pause")["ErrorID"] == 0
        assert not cell.do("state")["moving"]
        assert ask(Command="FRC_GetStatus")["ProgramStatus"] == 1
        assert ask(Command="FRC_Continue")["ErrorID"] == 0
        until(lambda: cell.do("state")["moving"])
        assert ask(Command="FRC_Continue")["ErrorID"] == 2556938  # RMIT-010
        assert ask(Command="FRC_Abort")["ErrorID"] == 0
        assert not cell.do("state")["moving"]
