"""Arbitrary input of parsers: only our errors are raised, and written text reads back."""

from __future__ import annotations

import string
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import (
    AbbArm,
    AbbDeadlines,
    AcquisitionError,
    CommandRefused,
    ConfigError,
    LinkLost,
    ProtocolError,
)
from drivers.abb.conversation import parse_numbered
from drivers.bridge import mbp
from drivers.link import parse_url
from mocks.shared import mbp as bridge
from tests.drivers.hearing import hearing

NAMES = st.text(string.ascii_lowercase, min_size=1, max_size=8)
VALUES = st.one_of(
    st.integers(-(10**9), 10**9),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(string.ascii_letters + string.digits + "_.,-", min_size=1, max_size=12),
)


def test_checksum_of_the_specification() -> None:
    assert mbp.checksum(b"123456789") == "29B1"
    assert bridge.crc(b"123456789") == 0x29B1


@given(st.binary(max_size=600))
def test_any_bytes_as_mbp(data: bytes) -> None:
    try:
        message = mbp.parse(data)
    except ProtocolError:
        return
    assert message.kind in ("OK", "ERR", "ACK", "EVENT", "SAMPLE")


@given(st.binary(max_size=100))
def test_any_body_with_a_good_sum(body: bytes) -> None:
    try:
        mbp.parse(body + b"*" + mbp.checksum(body).encode())
    except ProtocolError:
        return


@given(st.integers(1, 2**31 - 1), st.dictionaries(NAMES, VALUES, max_size=8))
def test_requests_are_read_by_the_bridge(number: int, fields: dict[str, Any]) -> None:
    got = bridge.request(mbp.encode(number, "MEASURE", fields))
    assert got is not None
    assert got[:2] == (number, "MEASURE")
    for key, value in fields.items():
        assert type(value)(got[2][key]) == value


@given(st.integers(1, 2**31 - 1), st.dictionaries(NAMES, VALUES, max_size=8))
def test_answers_of_the_bridge_are_read(number: int, fields: dict[str, Any]) -> None:
    data = bridge.line(f"{number} OK {bridge.pairs(**fields)}".rstrip())
    message = mbp.parse(data.removesuffix(b"\n"), checksum_needed=True)
    assert (message.kind, message.number) == ("OK", number)
    for key, value in fields.items():
        assert type(value)(message.fields[key]) == value


@given(st.integers(0, 60), st.integers(0, 7))
def test_every_wrong_bit_is_seen(at: int, bit: int) -> None:
    good = bridge.line("17 OK x=1.25 y=-3.5 z=2.0 t=12.0 age=0.0").removesuffix(b"\n")
    at %= len(good)
    bad = good[:at] + bytes([good[at] ^ (1 << bit)]) + good[at + 1 :]
    try:
        message = mbp.parse(bad, checksum_needed=True)
    except ProtocolError:
        return
    assert message.fields == mbp.parse(good).fields  # only the case of a digit of the sum may differ


@pytest.mark.parametrize(
    "line",
    [
        b"1 OK x=1  y=2",
        b"1 OK x=1 ",
        b"1 OK x=1 x=2",
        b"1 OK x",
        b"1 OK =1",
        b'1 ERR code=1 text="open',
        b"1 DONE x=1",
        b"OK x=1",
        b"1",
        b"",
        b"1 OK x=\xff",
    ],
)
def test_lines_that_are_not_messages(line: bytes) -> None:
    with pytest.raises(ProtocolError):
        mbp.parse(line)


def test_quoted_text_and_events() -> None:
    message = mbp.parse(b'7 ERR code=302 text="target lost, look" retry=1\r')
    assert message.fields["text"] == "target lost, look"
    event = mbp.parse(b"! 3 BEAM_BROKEN t=1.5")
    assert (event.kind, event.event, event.number) == ("EVENT", "BEAM_BROKEN", 3)
    assert mbp.parse(b"# 12 t=0.5").kind == "SAMPLE"


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e999", "x", "11"])
def test_numbers_are_finite_and_in_range(text: str) -> None:
    with pytest.raises(ProtocolError, match="x"):
        mbp.number(mbp.parse(f"1 OK x={text}".encode()), "x", 0.0, 10.0)


@given(st.binary(max_size=90))
def test_any_bytes_as_calsrv(data: bytes) -> None:
    try:
        answer = parse_numbered(data, 202, 17)
    except ProtocolError:
        return
    assert data.startswith(b"202 0 " if b" 0 " in data[:6] else b"202 1 17")
    assert answer.raw == data


@given(st.integers(0, 1), st.integers(1, 9999), st.integers(200, 208))
def test_calsrv_answers_to_other_questions(ok: int, number: int, code: int) -> None:
    line = f"{code} {ok} {'' if ok else '2 '}{number}".encode()
    if (number, code) != (17, 202):
        with pytest.raises(ProtocolError):
            parse_numbered(line, 202, 17)


STOCK = b"4 1 10.50 -20.25 0.00 -0.13 90.00 -179.99"
STOCK_TEXT = st.text("0123456789 .-#", max_size=60).map(str.encode)


def stock_position(*answers: bytes, reply_s: float = 5.0) -> tuple[float, ...] | None:
    """Return the joints that the driver reads from a stock server's answers to joints and ping.

    The result is None if an error of ours is raised.
    """
    arm = AbbArm("tcp://127.0.0.1:1", deadlines=AbbDeadlines(ping_s=5.0, reply_s=reply_s, quiet_s=0.002))
    with hearing(arm._main.link, *answers):
        try:
            return arm._read_back().joints_deg
        except AcquisitionError:
            return None


@given(st.one_of(st.binary(max_size=150), STOCK_TEXT, STOCK_TEXT.map(lambda rest: b"4 1 " + rest)))
def test_any_bytes_as_open_abb(data: bytes) -> None:
    joints = stock_position(data, b"0 1 ", reply_s=0.002)  # an answer that lacks its end costs the deadline
    if joints is not None:
        assert [float(field) for field in data.split()] == [4.0, 1.0, *joints]


def test_who_a_robot_is_takes_two_answers_that_agree() -> None:
    """A wrong digit of a serial number would make the record refuse its own robot for ever."""
    damaged, good = b"98 1 120-5O0017*6.08*IRB 120-3/0.6", b"98 1 120-500017*6.08*IRB 120-3/0.6"
    arm = AbbArm("tcp://127.0.0.1:1", deadlines=AbbDeadlines(ping_s=5.0, reply_s=5.0, quiet_s=0.01))
    with hearing(arm._main.link, *(each for said in (damaged, good, good) for each in (said, b"0 1 ")), b""):
        assert arm.identify().serial == "120-500017"
    others = (b"98 1 120-%06d*6.08*IRB 120-3/0.6" % k for k in range(4))
    with (
        hearing(arm._main.link, *(each for said in others for each in (said, b"0 1 ")), b""),
        pytest.raises(ProtocolError, match="no two answers"),
    ):
        arm.identify()


@given(st.binary(min_size=1, max_size=20), st.integers(0, len(STOCK) - 1))
def test_more_or_less_than_an_answer_of_open_abb(more: bytes, length: int) -> None:
    assert stock_position(STOCK, b"0 1 ") == (10.5, -20.25, 0.0, -0.13, 90.0, -179.99)
    assert stock_position(STOCK + more, b"0 1 ") is None
    assert stock_position(STOCK, more) is None or more == b"0 1 "
    assert stock_position(STOCK[:length]) is None


@pytest.mark.parametrize("last", [b"-180", b"-179.9", b"-179."])
def test_an_answer_of_open_abb_may_leave_zeros_at_the_end_out(last: bytes) -> None:
    """It is not documented whether NumToStr of RAPID writes them.

    The late part of one answer would spoil the next answer.
    """
    said = b"4 1 10.5 -20.25 0 -0.13 90 " + last
    assert stock_position(said, b"0 1 ", b"") == (10.5, -20.25, 0.0, -0.13, 90.0, float(last))
    assert stock_position(said, b"90 1 ", b"") is None  # the rest of it, and the ping


@given(st.one_of(st.binary(max_size=150), STOCK_TEXT))
def test_any_bytes_as_the_log_of_open_abb(data: bytes) -> None:
    arm = AbbArm("tcp://127.0.0.1:1")
    with hearing(arm._back.link, data, unasked=True):
        try:
            joints = arm._back.log_joints()
        except AcquisitionError:
            return
    assert len(joints) == 6


@given(st.text(max_size=40))
def test_any_text_as_address(text: str) -> None:
    try:
        address = parse_url(text)
    except ConfigError:
        return
    assert 0 < address.port < 65536


def test_errors_describe_themselves() -> None:
    def kinds(kind: type[AcquisitionError]) -> list[type[AcquisitionError]]:
        return [kind, *(k for sub in kind.__subclasses__() for k in kinds(sub))]

    every = kinds(AcquisitionError)
    codes = [kind.code for kind in every]
    assert len(set(codes)) == len(codes)
    for kind in every:
        error = kind("message", device="d", command="c", raw=b"\xff")
        assert error.what_to_do.endswith(".")
        assert error.as_dict()["raw"] == "\xff"
        assert f"[{kind.code}]" in str(error)


def test_the_words_of_a_device_give_the_terminal_no_orders() -> None:
    error = CommandRefused("bridge says 501: \x1b[2J\x07gone\x9b1m", raw=b"\x1b[2J")
    assert error.sentence.startswith("bridge says 501: \ufffd[2J\ufffdgone\ufffd1m. ")
    assert error.as_dict()["raw"] == "\x1b[2J"  # the record keeps what came


def test_an_error_says_of_which_device_it_speaks() -> None:
    """A person has two devices, and one of them closed the connection."""
    assert LinkLost("connection lost", device="faro").sentence.startswith(
        "faro: connection lost. Check cable"
    )
    assert ConfigError("no port for faro", device="faro").sentence.startswith("no port for faro. ")
    assert ConfigError("the robot is another", device="robot").sentence.startswith("the robot is another. ")
