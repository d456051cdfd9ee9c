"""The states that an abb_driver controller sends by itself, ten per second (TCP 11002).

A thread reads them all the time and keeps only the last one. If the stream were left unread for minutes, it would fill
the buffers, and the next state read would be minutes old. A question waits for states that come after it was asked. Any
fault ends the thread, closes the link and is raised by the next question. The wire log gets only the states that were
used; all of them would be 20 MB per hour.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

from drivers.abb.simple_packets import STATE_SIZE, AbbState, parse_state
from drivers.errors import LinkError, LinkLost, LinkTimeout
from drivers.link import TcpLink, WireSink


@dataclass(frozen=True, slots=True)
class AbbSimpleDeadlines:
    """Named waits in seconds.

    A move may take `move_factor` x the requested time + `move_margin_s`.

    Attributes
    ----------
    takeover_s
        Time in which a server notices that its last client is gone.
    settle_s
        Time until three states agree on a robot at rest.
    still_s
        A robot that rests for this time during a move has been stopped.
    """

    connect_s: float = 3.0
    send_s: float = 1.0
    takeover_s: float = 1.0
    reply_s: float = 2.0
    stop_s: float = 1.0
    settle_s: float = 3.0
    still_s: float = 2.0
    move_factor: float = 2.0
    move_margin_s: float = 10.0


class StateStream:
    """The newest state of one controller.

    `following` may be called from any thread. `wire` gets only the states that were requested.
    """

    def __init__(self, link: TcpLink, deadlines: AbbSimpleDeadlines, wire: WireSink | None) -> None:
        self.deadlines = deadlines
        self._device, self._link, self._wire = link.device, link, wire
        self._news = threading.Condition()
        self._reader: threading.Thread | None = None
        self._count = 0
        self._state: AbbState | None = None
        self._fault: LinkError | None = _closed()

    def open(self) -> None:
        """Connect and wait for a first state.

        Raises
        ------
        LinkError
            The connection failed.
        """
        self.close()
        self._link.open(connect_s=self.deadlines.connect_s)
        with self._news:
            self._state = self._fault = None
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self.following(self.count, "connect")

    def close(self) -> None:
        """Close, and wake threads that wait for a state; never raises."""
        self._link.close()
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.join()
        with self._news:
            self._fault = _closed()

    @property
    def count(self) -> int:
        """Number of the newest state."""
        return self._count

    def following(self, number: int, command: str) -> tuple[int, AbbState]:
        """Wait for a state with a number greater than `number`; return the newest with its number.

        Raises
        ------
        LinkError
            The stream failed, or no state came in time.
        """
        end = self._link.clock() + self.deadlines.reply_s
        with self._news:
            while self._count <= number or self._state is None:
                if self._fault is not None:
                    raise self._fault.__class__(
                        self._fault.message, device=self._device, command=command, raw=self._fault.raw
                    ) from self._fault
                left = end - self._link.clock()
                if left <= 0:
                    self._link.close()
                    raise LinkTimeout(
                        f"no state within reply_s = {self.deadlines.reply_s:g} s",
                        device=self._device,
                        command=command,
                    )
                self._news.wait(left)
            if self._wire is not None:
                self._wire.record(self._device, "<", self._state.raw)
            return self._count, self._state

    def _read(self) -> None:
        try:
            with self._link.question("state", unread_allowed=True):
                while True:
                    state = parse_state(
                        self._link.read_exactly(
                            STATE_SIZE, command="state", deadline="reply_s", seconds=self.deadlines.reply_s
                        )
                    )
                    with self._news:
                        self._count, self._state = self._count + 1, state
                        self._news.notify_all()
        except LinkError as error:
            with self._news:
                self._fault = error
                self._news.notify_all()


def _closed() -> LinkLost:
    return LinkLost("not connected")
