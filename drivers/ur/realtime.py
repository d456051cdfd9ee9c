"""The real-time client interface of a UR controller, TCP 30003: states, and URScript.

The controller sends a packet every 8 ms from the moment of the connection, big-endian: length (u32, with itself), then
doubles. URScript goes in the other direction. The stream cannot be paused, so **every question opens a separate
connection**. A packet that arrives on it was then sent after the question.

Length and offsets by version: Universal Robots, "Remote control via TCP/IP", sheet of the real-time interface. They are
read from 3.2 on, which includes the program state.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from drivers.errors import ProtocolError, naming
from drivers.link import TcpLink
from drivers.ur.deadlines import UrDeadlines
from drivers.ur.state import StateConfirmer, UrState, check_state

LENGTHS = (1060, 1108, 1116, 1140, 1220)  # 3.2, 3.5 and 5.0, 3.10 and 5.4, 3.14 and 5.9, 5.10
_TIME, _Q_TARGET, _QD_TARGET, _Q_ACTUAL, _QD_ACTUAL = 4, 12, 60, 252, 300
_ROBOT_MODE, _SAFETY_MODE, _PROGRAM_STATE = 756, 812, 1052


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
    )
    check_state(state)
    return state


class Realtime:
    """Questions to port 30003, from any thread: they share nothing.

    `connect` returns a link that is not open.
    """

    numbered = False  # no register comes back on this port, and no watchdog can be fed through it
    confirms = False

    def __init__(self, connect: Callable[[], TcpLink], device: str, deadlines: UrDeadlines) -> None:
        self._connect = connect
        self.device = device
        self.deadlines = deadlines
        self._asked: set[TcpLink] = set()

    @contextmanager
    def watch(self, command: str, *, guarding: bool = False) -> Iterator[StateConfirmer]:
        """Yield states from now on, until the block ends; a program cannot be guarded here.

        Raises
        ------
        LinkError
            The connection failed.
        """
        with self._connection(command) as link:
            yield StateConfirmer(lambda: self._next(link, command))

    @contextmanager
    def talk(
        self, command: str, *, outlives_close: bool = False
    ) -> Iterator[tuple[StateConfirmer, Callable[[str], None]]]:
        """Open a connection to read states and send a program.

        A UR controller must have sent a state first, except for a stop, which does not wait for that. The connection is
        held until the controller has read the program: closing it with states unread resets it. With `outlives_close`,
        `close` leaves it open, as a stop needs.

        Raises
        ------
        LinkError
            The connection failed.
        """
        with self._connection(command, outlives_close=outlives_close) as link:
            if not outlives_close:
                self._next(link, command)
            yield (
                StateConfirmer(lambda: self._next(link, command)),
                lambda program: link.send(
                    program.encode("ascii"), command=command, send_s=self.deadlines.send_s
                ),
            )

    def close(self) -> None:
        """End every pending question except a stop; never raises."""
        for link in tuple(self._asked):
            link.close()

    def open(self) -> None:
        """Check that a UR controller answers.

        Raises
        ------
        LinkError
            The connection failed.
        """
        with self.watch("connect") as witness:
            witness.state()

    def claim(self) -> None:
        """Do nothing: this port does not report which client controls."""

    def release(self, number: int) -> None:
        """Do nothing: a program without a number does not wait."""

    @contextmanager
    def _connection(self, command: str, *, outlives_close: bool = False) -> Iterator[TcpLink]:
        link = self._connect()
        if not outlives_close:
            self._asked.add(link)
        try:
            link.open(connect_s=self.deadlines.connect_s)
            with naming(self.device, command):
                yield link
        finally:
            self._asked.discard(link)
            link.close()

    def _next(self, link: TcpLink, command: str) -> UrState:
        def part(count: int) -> bytes:
            return link.read_exactly(
                count, command=command, deadline="reply_s", seconds=self.deadlines.reply_s
            )

        head = part(4)
        (length,) = struct.unpack(">I", head)
        return parse_packet(head + part(length - 4) if length in LENGTHS else head)
