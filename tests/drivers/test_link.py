"""The link layer: every fault closes the link, and no old bytes are left before a request.

Exact ends, named deadlines, and the wire log are tested too.
"""

from __future__ import annotations

import io
import json
import re
import socket
from collections.abc import Iterator
from contextlib import suppress

import pytest

from drivers import ConfigError, LinkLost, LinkTimeout, ProtocolError
from drivers.link import Address, TcpLink, WireLog, endpoints, parse_url
from tests.drivers.nobody import nobody_listens
from tests.drivers.waiting import PATIENCE_S, in_thread, until


class Pair:
    """A link and the device's end of it."""

    def __init__(self) -> None:
        self.wire = io.StringIO()
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
            self.link = TcpLink(Address("127.0.0.1", port), "dev", wire=WireLog(self.wire, clock=lambda: 1.5))
            self.link.open(connect_s=PATIENCE_S)
            self.device, _ = server.accept()

    def read(self, seconds: float = PATIENCE_S, limit: int = 512) -> bytes:
        return self.link.read_until(b"\n", command="X", deadline="reply_s", seconds=seconds, limit=limit)


@pytest.fixture
def pair() -> Iterator[Pair]:
    pair = Pair()
    yield pair
    pair.link.close()
    pair.device.close()


def ask(pair: Pair, seconds: float = PATIENCE_S) -> bytes:
    with pair.link.question("X"):
        pair.link.send(b"q\n", command="X", send_s=PATIENCE_S)
        return pair.read(seconds)


def test_question_and_answer(pair: Pair) -> None:
    pair.device.sendall(b"")
    answer = in_thread(lambda: ask(pair))
    assert pair.device.recv(10) == b"q\n"
    pair.device.sendall(b"ans")
    pair.device.sendall(b"wer\n")
    assert answer.result(PATIENCE_S) == b"answer"
    rows = [json.loads(row) for row in pair.wire.getvalue().splitlines()]
    assert rows[1] == {"t_s": 1.5, "device": "dev", "dir": ">", "data": "q\n"}
    assert "".join(row["data"] for row in rows if row["dir"] == "<") == "answer\n"


def test_half_a_line_at_the_end_of_the_stream_is_an_error(pair: Pair) -> None:
    answer = in_thread(lambda: ask(pair))
    pair.device.recv(10)
    pair.device.sendall(b"10")  # of 1001.2
    pair.device.shutdown(socket.SHUT_WR)
    with pytest.raises(LinkLost, match="in the middle") as caught:
        answer.result(PATIENCE_S)
    assert caught.value.raw == b"10"
    assert not pair.link.is_open


def test_deadline_is_named_and_closes(pair: Pair) -> None:
    with pytest.raises(LinkTimeout, match=r"reply_s = 0\.05 s") as caught:
        ask(pair, seconds=0.05)
    assert (caught.value.device, caught.value.command, caught.value.code) == ("dev", "X", 1001)
    assert not pair.link.is_open
    with pytest.raises(LinkLost, match="not connected"):
        ask(pair)


def test_nothing_unread_before_asking(pair: Pair) -> None:
    pair.device.sendall(b"late\n")
    until(lambda: pair.link._socket is not None and readable(pair.link._socket))
    with pytest.raises(ProtocolError, match="not requested"):
        ask(pair)
    assert not pair.link.is_open


def readable(sock: socket.socket) -> bool:
    sock.settimeout(0)
    with suppress(BlockingIOError):
        return bool(sock.recv(1, socket.MSG_PEEK))
    return False


def test_rest_of_a_glued_answer_is_not_the_next_answer(pair: Pair) -> None:
    answer = in_thread(lambda: ask(pair))
    pair.device.recv(10)
    pair.device.sendall(b"one\ntwo\n")
    assert answer.result(PATIENCE_S) == b"one"
    with pytest.raises(ProtocolError):
        ask(pair)


def test_device_gone_before_asking(pair: Pair) -> None:
    pair.device.close()
    until(lambda: pair.link._socket is not None and closed(pair.link._socket))
    with pytest.raises(LinkLost):
        ask(pair)


def closed(sock: socket.socket) -> bool:
    sock.settimeout(0)
    with suppress(BlockingIOError):
        return sock.recv(1, socket.MSG_PEEK) == b""
    return False


def test_endless_line(pair: Pair) -> None:
    pair.device.sendall(b"x" * 600)
    with pytest.raises(ProtocolError, match="512"):
        pair.read()


def test_any_exception_in_a_question_closes(pair: Pair) -> None:
    with pytest.raises(KeyboardInterrupt), pair.link.question("X"):
        raise KeyboardInterrupt
    assert not pair.link.is_open


def test_close_from_another_thread_wakes_the_reader(pair: Pair) -> None:
    answer = in_thread(lambda: ask(pair, seconds=2.0 * PATIENCE_S))
    pair.device.recv(10)
    pair.link.close()
    with pytest.raises(LinkLost):
        answer.result(PATIENCE_S)


def test_answer_without_terminator_ends_by_its_form(pair: Pair) -> None:
    form = re.compile(rb"4 1 \d+\.\d\d")

    def read() -> bytes:
        return pair.link.read_reply(
            form,
            command="4",
            deadline="reply_s",
            seconds=PATIENCE_S,
            possible=lambda got: b"4 1 ".startswith(got[:4]),
        )[0]

    answer = in_thread(read)
    for piece in (b"4", b" 1 1", b"2.", b"34"):
        pair.device.sendall(piece)
    assert answer.result(PATIENCE_S) == b"4 1 12.34"
    pair.device.sendall(b"5 1 ")
    with pytest.raises(ProtocolError):
        read()


def test_nobody_listens() -> None:
    with nobody_listens() as port, pytest.raises(LinkLost, match="port is closed") as lost:
        TcpLink(Address("127.0.0.1", port), "dev", enabled_at=lambda: "Enable it.").open(connect_s=1)
    assert lost.value.what_to_do.startswith("Cable and power are in order")
    assert lost.value.what_to_do.endswith("Enable it.")


@pytest.mark.parametrize(
    "url", ["", "host:1", "tcp://", "tcp://:5", "tcp://h:0", "tcp://h:1/path", "serial:///x"]
)
def test_bad_addresses(url: str) -> None:
    with pytest.raises(ConfigError):
        parse_url(url)


def test_addresses() -> None:
    assert parse_url("tcp://192.168.125.1:5000") == Address("192.168.125.1", 5000)
    assert parse_url("tcp://cell-pc:5000?background=6000").options == {"background": "6000"}


def test_addresses_of_datagrams_have_one_spelling_as_well() -> None:
    assert (
        endpoints("udp://localhost:10040") == endpoints("UDP://127.0.0.1:010040/?x=1") == {"loopback:10040"}
    )
    for other in ("udp://127.0.0.1", "http://127.0.0.1:10040"):
        with pytest.raises(ConfigError):
            endpoints(other)
    with pytest.raises(ConfigError, match="must begin with udp://"):
        parse_url("tcp://127.0.0.1:10040", scheme="udp")
