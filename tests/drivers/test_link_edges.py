"""Edge cases of the link layer: exact limits, counted answers, socket faults and options.

Each of these tests was required by a small change of `drivers/link.py` that no test had noticed
(tests/sabotage/mutants.py).
"""

from __future__ import annotations

import io
import itertools
import json
import re
import socket

import pytest

from drivers import ConfigError, LinkLost, LinkTimeout, ProtocolError
from drivers.link import Address, TcpLink, WireLog, beside, parse_url
from tests.drivers.test_link import Pair, pair
from tests.drivers.waiting import PATIENCE_S, until

__all__ = ["pair"]  # the fixture
WORD = re.compile(rb"[a-z]+")


class Scripted:
    """A socket that answers by a list: bytes are received, an exception is raised."""

    def __init__(self, *answers: bytes | Exception) -> None:
        self.answers = list(answers)
        self.timeouts: list[float] = []
        self.ended: list[str] = []
        self.sent: list[bytes] = []

    def recv(self, count: int) -> bytes:
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def sendall(self, data: bytes) -> None:
        self.sent.append(data)
        self.recv(0)

    def settimeout(self, seconds: float) -> None:
        self.timeouts.append(seconds)

    def shutdown(self, how: int) -> None:
        self.ended.append("shutdown")

    def close(self) -> None:
        self.ended.append("close")


def scripted(*answers: bytes | Exception, wire: WireLog | None = None) -> tuple[TcpLink, Scripted]:
    """Return a link on a scripted socket; its clock advances by a second each time it is read."""
    link = TcpLink(Address("h", 1), "dev", wire=wire, clock=itertools.count(0.0).__next__)
    sock = Scripted(*answers)
    link._socket = sock  # type: ignore[assignment]
    return link, sock


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("http://h:1", "must begin with tcp://"),
        ("tcp://h:99999", "Port out of range"),
        ("tcp://h:x", "'tcp://h:x': "),
        ("tcp://:1", "has a path"),
        ("tcp://a b:1", "has a path"),
        ("tcp://h:1/path", "has a path"),
        ("tcp://me@h:1", "has a path"),
        ("tcp://h", "has no port"),
        ("tcp://h:0", "has no port"),
    ],
)
def test_what_is_wrong_with_an_address_is_said(url: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        parse_url(url)


def test_another_port_of_the_same_controller() -> None:
    here = parse_url("tcp://h:30004?low=1&high=65535&zero=0&wide=65536&text=x&minus=-1")
    assert beside(here, "absent", 30003, "ur") == Address("h", 30003, here.options)
    assert [beside(here, name, 2, "ur").port for name in ("low", "high")] == [1, 65535]
    for name in ("zero", "wide", "text", "minus"):
        with pytest.raises(ConfigError, match=f"{name}=.* is not a port") as caught:
            beside(here, name, 2, "ur")
        assert caught.value.device == "ur"


def test_times_of_the_log_are_microseconds() -> None:
    stream = io.StringIO()
    WireLog(stream, clock=lambda: 1.23456789).record("dev", ">", b"\xff")
    assert json.loads(stream.getvalue()) == {"t_s": 1.234568, "device": "dev", "dir": ">", "data": "\xff"}


def test_what_is_set_on_a_connection(pair: Pair) -> None:
    """A request of some bytes leaves at once, and does not wait for another."""
    sock = pair.link._socket
    assert sock is not None
    assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1


def test_opening_again_closes_what_was_open_and_both_are_logged(pair: Pair) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        pair.link.address = Address("127.0.0.1", server.getsockname()[1])
        pair.link.open(connect_s=PATIENCE_S)
        pair.device.settimeout(PATIENCE_S)
        assert pair.device.recv(1) == b""
    pair.link.close()
    pair.link.close()
    rows = [json.loads(row) for row in pair.wire.getvalue().splitlines()]
    assert [row["data"].split()[0] for row in rows] == ["open", "close", "open", "close"]
    assert {row["dir"] for row in rows} == {"!"}


def test_closing_wakes_a_reader_before_it_closes() -> None:
    link, sock = scripted()
    link.close()
    assert sock.ended == ["shutdown", "close"]


def test_a_connection_that_is_not_taken_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def never(address: tuple[str, int], timeout: float) -> socket.socket:
        asked.append((address, timeout))
        raise TimeoutError

    monkeypatch.setattr(socket, "create_connection", never)
    with pytest.raises(LinkTimeout, match=r"h:1 did not accept within connect = 0\.25 s") as caught:
        TcpLink(Address("h", 1), "dev").open(connect_s=0.25)
    assert (asked, caught.value.command) == ([(("h", 1), 0.25)], "connect")
    assert "Check cable" in caught.value.what_to_do  # nothing there says a word


def test_requests_that_are_not_taken() -> None:
    link, sock = scripted(TimeoutError(), ConnectionResetError("gone"))
    with pytest.raises(LinkTimeout, match=r"within send = 0\.5 s"):
        link.send(b"q", command="X", send_s=0.5)
    with pytest.raises(LinkLost, match="connection lost: gone"):
        link.send(b"q", command="X", send_s=0.5)
    assert sock.timeouts == [0.5, 0.5]


def test_a_counted_answer_and_what_comes_behind_it() -> None:
    link, sock = scripted(b"ab", b"cdef")
    wanted = {"command": "X", "deadline": "reply", "seconds": 60.0}
    assert link.read_exactly(3, **wanted) == b"abc"
    assert link.read_exactly(3, **wanted) == b"def"  # all of it is there: nothing more is received
    assert sock.answers == []
    assert link.read_exactly(0, **wanted) == b""


def test_a_counted_answer_in_time_and_in_no_time() -> None:
    link, sock = scripted(b"a", b"b", b"c")
    with pytest.raises(LinkTimeout, match=r"reply = 2 s") as caught:
        link.read_exactly(
            9, command="X", deadline="reply", seconds=2.0
        )  # the clock: begun at 0, asked at 1, at 2
    assert (caught.value.raw, sock.timeouts) == (b"a", [1.0])


def test_lines_as_long_as_allowed_and_longer() -> None:
    wanted = {"command": "X", "deadline": "reply", "seconds": 60.0, "limit": 4}
    link, _ = scripted(b"abcd", b"\n")
    assert link.read_until(b"\n", **wanted) == b"abcd"
    link, _ = scripted(b"abcde\n")
    with pytest.raises(ProtocolError, match="line longer than 4 bytes") as caught:
        link.read_until(b"\n", **wanted)
    assert caught.value.raw == b"abcde"
    link, _ = scripted(b"abcde", b"\n")
    with pytest.raises(ProtocolError, match="no end of line within 4 bytes"):
        link.read_until(b"\n", **wanted)


def test_waiting_looks_around() -> None:
    """The link calls `meanwhile` between two waits on the socket, which last at most `poll_s`.

    Without `meanwhile`, it waits for the whole rest.
    """
    looked: list[None] = []
    link, sock = scripted(TimeoutError(), b"x\n")
    wanted = {"command": "X", "deadline": "reply", "seconds": 60.0}
    assert link.read_until(b"\n", **wanted, meanwhile=lambda: looked.append(None)) == b"x"
    assert (looked, sock.timeouts) == ([None], [0.1, 0.1])
    link, sock = scripted(b"x\n")
    assert link.read_until(b"\n", **wanted) == b"x"
    assert sock.timeouts == [59.0]


def test_a_connection_that_breaks_in_an_answer() -> None:
    link, _ = scripted(b"ab", ConnectionResetError("gone"))
    with pytest.raises(LinkLost, match="connection lost: gone") as caught:
        link.read_exactly(9, command="X", deadline="reply", seconds=60.0)
    assert caught.value.raw == b"ab"


def test_free_text_ends_where_nothing_more_comes() -> None:
    wanted = {"command": "X", "deadline": "reply", "seconds": 60.0, "possible": lambda data: True}
    link, sock = scripted(b"some", b"thing", TimeoutError())
    found = link.read_reply(WORD, quiet_s=0.25, **wanted)
    assert (found[0], sock.timeouts) == (b"something", [59.0, 0.25, 0.25])
    link, sock = scripted(b"some", b"thing")  # without quiet_s it ends by its form
    assert link.read_reply(WORD, **wanted)[0] == b"some"
    assert sock.answers == [b"thing"]
    link, _ = scripted(b"some", ConnectionResetError("gone"))
    with pytest.raises(LinkLost, match="connection lost: gone"):
        link.read_reply(WORD, quiet_s=0.25, **wanted)
    link, _ = scripted(b"some", b"")
    with pytest.raises(LinkLost, match="closed the connection in the middle"):
        link.read_reply(WORD, quiet_s=0.25, **wanted)


def test_a_connection_that_is_broken_before_asking(pair: Pair) -> None:
    pair.device.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # closing it resets it
    pair.device.close()

    def broken() -> bool:
        try:
            with pair.link.question("X"):
                return False
        except LinkLost as error:
            return "connection lost" in error.message or "closed the connection" in error.message

    until(broken)
    assert not pair.link.is_open
