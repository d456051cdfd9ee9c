"""The motion server of abb_driver (TCP 11000): a point and its reply at a time, and a stop.

The server accepts a second client but does not read from it; it carries out that client's messages when the first
client disconnects. A connection therefore counts as open when a stop was answered on it. A stop moves nothing and
discards the points of an earlier client.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from drivers.abb.simple_packets import ANSWER_SIZE, END, JOINTS, STOP, encode_point, parse_reply
from drivers.abb.simple_stream import AbbSimpleDeadlines
from drivers.errors import CommandRefused, LinkError, LinkLost, MotionStopped, naming
from drivers.link import TcpLink

_TAKEOVER_PAUSE_S = 0.05
_NOWHERE = (0.0,) * JOINTS, (0.0,) * 4, 0.0  # a stop carries no point


def patiently(open_: Callable[[], None], takeover_s: float, clock: Callable[[], float]) -> None:
    """Open, and retry for `takeover_s`.

    The server restarts when it notices that its last client has disconnected.
    """
    end = clock() + takeover_s
    while True:
        try:
            return open_()
        except LinkLost:
            if clock() >= end:
                raise
            time.sleep(_TAKEOVER_PAUSE_S)


class MotionServer:
    """The connection to the motion server: one point at a time, from any thread.

    `stopped` is set by a stop since the arming.
    """

    def __init__(self, link: TcpLink, deadlines: AbbSimpleDeadlines) -> None:
        self.deadlines = deadlines
        self.stopped = threading.Event()
        self._device, self._link = link.device, link
        self._saying = threading.RLock()  # one point and its reply: a stop has to wait for no more

    @property
    def is_open(self) -> bool:
        return self._link.is_open

    def open(self, command: str = "connect") -> None:
        """Connect and wait for the answer to a stop.

        Raises
        ------
        LinkError
            The connection failed.
        """
        stopping = command == "stop"
        connect_s = self.deadlines.stop_s if stopping else self.deadlines.connect_s

        def once() -> None:
            self._link.open(connect_s=connect_s)
            self.say(STOP, *_NOWHERE, command)

        with self._saying:
            patiently(once, self.deadlines.takeover_s, self._link.clock)

    def close(self) -> None:
        """Close; never raises."""
        self._link.close()

    def halt(self) -> None:
        """Send a stop, on a new connection if this one is lost.

        Raises
        ------
        LinkError
            The stop was not answered.
        """
        with self._saying:
            try:
                self.say(STOP, *_NOWHERE, "stop")
            except LinkError:
                self.open("stop")

    def halt_if_possible(self) -> None:
        """Halt after a move that did not end well; a lost connection stays closed."""
        with self._saying, suppress(LinkError):
            was_open = self.is_open
            self.halt()
            if not was_open:
                self.close()

    def say(
        self,
        sequence: int,
        joints_rad: Sequence[float],
        external: Sequence[float],
        duration_s: float,
        command: str,
    ) -> None:
        """Send one point and wait for its reply.

        Raises
        ------
        LinkError
            The connection failed.
        CommandRefused
            The controller answered FAILURE.
        MotionStopped
            The last point of a trajectory was not sent, because of a stop.
        """
        limits = self.deadlines
        name, seconds = ("stop_s", limits.stop_s) if command == "stop" else ("reply_s", limits.reply_s)
        with self._saying:
            if sequence == END and self.stopped.is_set():
                raise MotionStopped("stopped before it began", device=self._device, command=command)
            with self._link.question(command):
                data = encode_point(sequence, joints_rad, external, duration_s)
                self._link.send(data, command=command, send_s=limits.send_s)
                raw = self._link.read_exactly(ANSWER_SIZE, command=command, deadline=name, seconds=seconds)
                with naming(self._device, command):
                    taken = parse_reply(raw)
        if not taken:
            raise CommandRefused("controller answered FAILURE", device=self._device, command=command, raw=raw)
