"""Arbitrary answers of a Fanuc: only our errors are raised, only whole answers accepted."""

from __future__ import annotations

import struct
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import AcquisitionError, FanucDeadlines
from drivers.fanuc.mappdk import MappdkController, sealed
from drivers.fanuc.modbus import ModbusController, answers_to
from drivers.fanuc.registers import HmiProfile, IoProfile
from drivers.link import Address, TcpLink
from mocks.fanuc.mappdk import sealed as seal
from tests.drivers.hearing import hearing

DEADLINES = FanucDeadlines(reply_s=5.0)
NONES = b",j=none" * 3
GOOD = b"0:" + b",".join(b"j=%8.3f" % q for q in (10.5, -20.25, 0, -0.131, 90, -179.999)) + NONES
POSE = b"0:x= 475.000,y=   0.000,z= 375.000,w= 180.000,p= -90.000,r=   0.000"
HMI = struct.pack(">HHHBBB", 1, 0, 41, 1, 3, 38) + struct.pack(">19H", *([0, 0x4128] * 9), 1)
TEXT = st.text("0123456789:j=xyzwpr,. -none", max_size=60).map(str.encode)


def text_joints(*answers: bytes) -> tuple[float, ...]:
    controller = MappdkController(TcpLink(Address("h", 1), "fanuc"), DEADLINES)
    with hearing(controller._main.link, *answers):
        return controller.joints().joints_deg


def register_joints(data: bytes) -> tuple[float, ...]:
    controller = ModbusController(TcpLink(Address("h", 1, {"modbus": "hmi"}), "fanuc"), DEADLINES)
    with hearing(controller._registers.link, data):
        return controller.joints().joints_deg


def refused(parse: Callable[[bytes], object], data: bytes) -> bool:
    """Report whether an error of ours was raised; any other error fails the test."""
    try:
        parse(data)
    except AcquisitionError:
        return True
    return False


@given(st.one_of(st.binary(max_size=300), TEXT))
def test_any_bytes_as_mappdk(data: bytes) -> None:
    assert refused(text_joints, data)


@given(st.one_of(st.binary(max_size=300), st.binary(max_size=60).map(lambda rest: HMI[:8] + rest)))
def test_any_bytes_as_modbus(data: bytes) -> None:
    if data != HMI:
        assert refused(register_joints, data)


@given(st.integers(0, len(GOOD) - 1))
def test_half_an_answer_is_none(length: int) -> None:
    assert refused(text_joints, GOOD[:length])
    assert refused(register_joints, HMI[: length % len(HMI)])


@given(st.binary(min_size=1, max_size=20))
def test_more_than_an_answer_is_none(more: bytes) -> None:
    assert refused(lambda data: text_joints(data, POSE), GOOD + more)
    assert refused(lambda data: text_joints(GOOD, data), POSE + more)
    assert refused(register_joints, HMI + more)


def test_whole_answers_are_read() -> None:
    assert register_joints(HMI) == (10.5,) * 6
    assert text_joints(GOOD, POSE) == (10.5, -20.25, 0.0, -0.131, 90.0, -179.999)


@given(st.lists(st.floats(-999.9, 999.9), min_size=6, max_size=6), st.booleans())
def test_joints_as_karel_writes_them(joints: list[float], short: bool) -> None:
    """CNV_REAL_STR pads with blanks, and leaves out the zero before the point."""
    fields = [f"{q:8.3f}".replace("0.", ".") if short and abs(q) < 1 else f"{q:8.3f}" for q in joints]
    answer = ("0:" + ",".join(f"j={field}" for field in fields)).encode() + NONES
    assert text_joints(answer, POSE) == pytest.approx(joints, abs=0.00051)


@given(st.text("abc=,0123456789", min_size=1, max_size=40), st.integers(0, 39), st.integers(0, 7))
def test_every_wrong_bit_of_our_own_answers_is_seen(text: str, at: int, bit: int) -> None:
    good = seal(text).encode()
    assert sealed(good)
    at %= len(good)
    assert not sealed(good[:at] + bytes([good[at] ^ (1 << bit)]) + good[at + 1 :])


@given(st.integers(1, 65535), st.integers(0, 65535), st.integers(1, 125), st.sampled_from([3, 4]))
def test_answers_to_a_read_request(transaction: int, address: int, count: int, function: int) -> None:
    request = struct.pack(">HHHBBHH", transaction, 0, 6, 1, function, address, count)
    (head, rest), (refusal, code) = answers_to(request)
    assert head + bytes(rest) == struct.pack(
        ">HHHBBB", transaction, 0, 3 + 2 * count, 1, function, 2 * count
    ) + bytes(2 * count)
    assert refusal + bytes(code) == struct.pack(">HHHBBB", transaction, 0, 3, 1, function | 128, 0)


class Words:
    """Registers that hold any words."""

    def __init__(self, words: list[int]) -> None:
        self.words = words

    def read(self, table: str, address: int, count: int) -> list[int]:
        return [self.words[(address + i) % len(self.words)] for i in range(count)]

    def write(self, address: int, words: object) -> None: ...

    def poke(self, address: int, words: object) -> None: ...


@given(st.lists(st.integers(0, 65535), min_size=1, max_size=64))
def test_any_registers_as_a_state(words: list[int]) -> None:
    for profile in (HmiProfile(), IoProfile(0, 100, "input")):
        progress = profile.progress(Words(words))
        assert 0 <= progress.taken <= 65535
        status = profile.status(Words(words))
        assert status.mode in ("auto", "unknown")
        assert len(profile.joints(Words(words))[0]) == 6
