"""The real-time client interface of a UR controller, TCP 30003: states, and URScript.

The controller sends a packet every 8 ms from the moment of the connection, big-endian: length (u32, with itself), then
doubles. URScript goes in the other direction.

Length and offsets by version: Universal Robots, "Remote control via TCP/IP", sheet of the real-time interface. They are
read from 3.2 on, which includes the program state.
"""

from __future__ import annotations

import struct

from drivers.errors import ProtocolError
from drivers.link import TcpLink
from drivers.ur.script_port import ScriptPort
from drivers.ur.software import REALTIME
from drivers.ur.state import UrState, check_state

LENGTHS = (1060, 1108, 1116, 1140, 1220)  # 3.2, 3.5 and 5.0, 3.10 and 5.4, 3.14 and 5.9, 5.10
_TIME, _Q_TARGET, _QD_TARGET, _Q_ACTUAL, _QD_ACTUAL = 4, 12, 60, 252, 300
_TEMPERATURES, _ROBOT_MODE, _SAFETY_MODE, _SPEED, _PROGRAM_STATE = 692, 756, 812, 940, 1052


def parse_packet(packet: bytes) -> UrState:
    """Parse the state in a packet with its length field.

    Raises
    ------
    ProtocolError
        The bytes are not such a packet, or a value is out of range.
    """

    def numbers(offset: int, count: int) -> tuple[float, ...]:
        return struct.unpack_from(f">{count}d", packet, offset)

    (length,) = struct.unpack_from(">I", packet.ljust(4, b"\0"))
    if length not in LENGTHS or length != len(packet):
        raise ProtocolError("not a real-time packet of software 3.2 or later", raw=packet[:64])
    modes = [numbers(offset, 1)[0] for offset in (_ROBOT_MODE, _SAFETY_MODE, _PROGRAM_STATE)]
    if not all(float(mode).is_integer() for mode in modes):
        raise ProtocolError("mode is not a whole number", raw=packet[:64])
    robot_mode, safety_mode, program_state = map(int, modes)
    state = UrState(
        t_s=numbers(_TIME, 1)[0],
        target_rad=numbers(_Q_TARGET, 6),
        actual_rad=numbers(_Q_ACTUAL, 6),
        target_rad_s=numbers(_QD_TARGET, 6),
        actual_rad_s=numbers(_QD_ACTUAL, 6),
        robot_mode=robot_mode,
        safety_mode=safety_mode,
        runtime_state=program_state,
        echo=None,
        raw=packet,
        temperatures_c=numbers(_TEMPERATURES, 6),
        speed_share=numbers(_SPEED, 1)[0],
    )
    check_state(state)
    return state


class Realtime(ScriptPort):
    """Port 30003."""

    name = "realtime"
    service = REALTIME

    def _next(self, link: TcpLink, command: str, *, sent: bool = False) -> UrState:
        def part(count: int) -> bytes:
            return link.read_exactly(
                count, command=command, deadline="reply_s", seconds=self.deadlines.reply_s
            )

        head = part(4)
        (length,) = struct.unpack(">I", head)
        return parse_packet(head + part(length - 4) if length in LENGTHS else head)
