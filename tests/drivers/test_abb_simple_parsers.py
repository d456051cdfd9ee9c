"""Arbitrary messages of simple_message.

The parser raises only ProtocolError, and reads written messages back.
"""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import ProtocolError
from drivers.abb.simple_packets import ANSWER_SIZE, STATE_SIZE, encode_point, parse_reply, parse_state
from mocks.abb.simple import f32, i32, message, point

ANGLES = st.floats(-17.0, 17.0, width=32)
SIX, FOUR = st.tuples(*[ANGLES] * 6), st.tuples(*[st.floats(-100, 100, width=32) | st.just(9e6)] * 4)
TRISTATE = st.sampled_from((-1, 0, 1))
FLAGS = st.tuples(
    TRISTATE,
    TRISTATE,
    st.integers(-(2**31), 2**31 - 1),
    TRISTATE,
    TRISTATE,
    st.sampled_from((-1, 1, 2)),
    TRISTATE,
)
KNOWN = {-1: None, 0: False, 1: True}


def state(joints: tuple[float, ...], external: tuple[float, ...], flags: tuple[int, ...]) -> bytes:
    return message(10, 1, 0, i32(0) + f32(*joints, *external)) + message(13, 1, 0, i32(*flags))


GOOD = state((0.1, -0.2, 0.3, -0.4, 0.5, -0.6), (9e6,) * 4, (1, 0, 0, 0, 0, 2, 1))


@given(st.binary(max_size=200) | st.binary(min_size=STATE_SIZE, max_size=STATE_SIZE))
def test_any_bytes_as_a_state(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        parse_state(data)


@given(st.binary(min_size=40, max_size=40), st.binary(min_size=28, max_size=28))
def test_any_body_of_good_messages(joints: bytes, status: bytes) -> None:
    try:
        got = parse_state(message(10, 1, 0, i32(0) + joints) + message(13, 1, 0, status))
    except ProtocolError:
        return
    assert all(abs(q) < 1000.0 for q in got.joints_deg)
    assert got.flags.mode in ("auto", "manual", "unknown")


@given(SIX, FOUR, FLAGS)
def test_states_of_the_simulator_are_read(
    joints: tuple[float, ...], external: tuple[float, ...], flags: tuple[int, ...]
) -> None:
    got = parse_state(state(joints, external, flags))
    assert (got.joints_rad, got.external) == (joints, external)
    drives, e_stop, code, error, motion, mode, possible = flags
    assert (got.flags.motors_on, got.flags.emergency_stop) == (KNOWN[drives], KNOWN[e_stop])
    assert (got.flags.in_error, got.flags.error_code) == (KNOWN[error], code)
    assert (got.flags.moving, got.flags.motion_possible) == (KNOWN[motion], KNOWN[possible])
    assert got.flags.mode == {-1: "unknown", 1: "manual", 2: "auto"}[mode]


@given(SIX)
def test_resolution_is_the_step_to_the_next_number(joints: tuple[float, ...]) -> None:
    got = parse_state(state(joints, (0.0,) * 4, (1, 0, 0, 0, 0, 2, 1)))
    largest = max(map(abs, joints))
    (bits,) = struct.unpack("<I", struct.pack("<f", largest))
    (following,) = struct.unpack("<f", struct.pack("<I", bits + 1))
    step_deg = math.degrees(following - largest)
    assert got.resolution_deg == pytest.approx(step_deg) or largest < 2.0**-126


@given(st.sampled_from((-1, -3, -4)), SIX, FOUR, st.floats(0.0, 1000.0, width=32))
def test_points_are_read_by_the_simulator(
    sequence: int, joints: tuple[float, ...], external: tuple[float, ...], duration_s: float
) -> None:
    data = encode_point(sequence, joints, external, duration_s)
    assert int.from_bytes(data[:4], "little") == len(data) - 4
    got = point(data[4:])
    assert got is not None
    assert (got.sequence, got.duration_s, got.wants_reply) == (sequence, duration_s, True)
    assert got.joints_deg == pytest.approx([math.degrees(q) for q in joints])


@given(st.integers(0, 8 * len(GOOD) - 1))
def test_a_wrong_bit_is_seen_or_changes_one_number(at: int) -> None:
    bad = bytearray(GOOD)
    bad[at // 8] ^= 1 << at % 8
    good = parse_state(GOOD)
    try:
        got = parse_state(bytes(bad))
    except ProtocolError:
        return
    joints = zip(good.joints_rad + good.external, got.joints_rad + got.external, strict=True)
    assert sum(a != b for a, b in joints) + (good.flags != got.flags) <= 1


@given(st.binary(max_size=40) | st.binary(min_size=ANSWER_SIZE, max_size=ANSWER_SIZE))
def test_any_bytes_as_a_reply(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        parse_reply(data)


def test_replies() -> None:
    assert parse_reply(message(11, 3, 1))
    assert not parse_reply(message(11, 3, 2))
    for other in (message(11, 3, 0), message(11, 2, 1), message(10, 3, 1), message(11, 3, 1, b"\0\0\0\0")):
        with pytest.raises(ProtocolError):
            parse_reply(other)
