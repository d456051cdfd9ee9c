"""A port of a UR controller that streams states and takes URScript.

Each question opens a separate connection. The controller streams from the moment of the connection, and its stream
cannot be paused. A package that arrives on a connection opened for a question was therefore sent after the question.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ClassVar, Self

from drivers.errors import LinkError, naming
from drivers.link import TcpLink
from drivers.ur.deadlines import UrDeadlines
from drivers.ur.state import StateConfirmer, UrState


def refuses(link: TcpLink, connect_s: float) -> bool:
    """Check whether the controller refuses this connection; never raises."""
    try:
        link.open(connect_s=connect_s)
    except LinkError as error:
        return isinstance(error.__cause__, ConnectionRefusedError)
    finally:
        link.close()
    return False


class ScriptPort:
    """Questions to one port, from any thread: they share nothing.

    `connect` returns a link that is not open. No register comes back on such a port, and no watchdog can be fed through
    it: `numbered` and `confirms` are false.
    """

    name: ClassVar[str]
    service: ClassVar[str]
    numbered = False
    confirms = False

    def __init__(self, connect: Callable[[], TcpLink], device: str, deadlines: UrDeadlines) -> None:
        self._connect = connect
        self.device = device
        self.deadlines = deadlines
        self._asked: set[TcpLink] = set()

    def _next(self, link: TcpLink, command: str, *, sent: bool = False) -> UrState:
        """Read the next state of a link, on which a program was `sent` or not.

        Raises
        ------
        LinkError
            The connection failed.
        WrongMode
            The controller refused the program that was sent.
        """
        raise NotImplementedError

    def hasty(self) -> Self:
        """Return the same port with the short deadlines of a stop."""
        return type(self)(self._connect, self.device, self.deadlines.quick)

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
        """Open a connection to send a program and read states; a refused program is WrongMode.

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
                StateConfirmer(lambda: self._next(link, command, sent=True)),
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
