"""Parsers of the UR driver fed with anything, and the rule by which a state is believed."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from drivers import LinkError, ProtocolError, UrDeadlines
from drivers.link import Address, TcpLink
from drivers.ur.motion import UrScriptMove
from drivers.ur.realtime import LENGTHS, parse_packet
from drivers.ur.rtde import Rtde, encode, parse_data, parse_text
from drivers.ur.secondary import parse_configuration, parse_kinematics, parse_version, split_packages
from drivers.ur.state import ROBOT_MODES, StateConfirmer, UrState, agree
from mocks.ur.packets import Dh, configuration, kinematics, package, realtime_packet, version_message
from mocks.ur.script import ScriptError, ScriptReader, parse_call, parse_program
from tests.drivers.hearing import hearing

ANGLES = st.lists(st.floats(-6.3, 6.3), min_size=6, max_size=6).map(tuple)
ARGUMENTS = (0.5, 0.25, -1.5, 0.0, 0.125, 2.0, 1.0, 0.5, 0.0, 0.5)
SPEEDS = st.lists(st.floats(-3.2, 3.2), min_size=6, max_size=6).map(tuple)


def at(t_s: float, q: tuple[float, ...] = (0.5,) * 6, v: tuple[float, ...] = (0.0,) * 6) -> bytes:
    return realtime_packet(
        time=t_s,
        q_target=q,
        q_actual=q,
        qd_target=v,
        qd_actual=v,
        robot_mode=7,
        safety_mode=1,
        program_state=1,
    )


def rtde(t_s: float, q: tuple[float, ...] = (0.5,) * 6, v: tuple[float, ...] = (0.0,) * 6) -> bytes:
    return b"\1" + struct.pack(">25d", t_s, *q, *q, *v, *v) + struct.pack(">iiIi10d", 7, 1, 1, 3, *ARGUMENTS)


@given(st.binary(max_size=1300))
def test_any_bytes_as_packet(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        parse_packet(data)


@given(st.sampled_from(LENGTHS), st.binary(min_size=1056, max_size=1056))
def test_any_content_of_a_packet(length: int, body: bytes) -> None:
    try:
        state = parse_packet((struct.pack(">I", length) + body).ljust(length, b"\0"))
    except ProtocolError:
        return
    assert state.robot_mode in ROBOT_MODES
    assert all(map(math.isfinite, state.actual_rad + state.target_rad + state.actual_rad_s))


@given(ANGLES, SPEEDS, st.integers(-1, 8), st.integers(1, 13), st.integers(0, 5))
def test_packet_of_the_simulator_is_read(
    q: tuple[float, ...], v: tuple[float, ...], robot: int, safety: int, program: int
) -> None:
    packet = realtime_packet(
        time=1.5, q_target=q, q_actual=v, qd_target=v, qd_actual=q, robot_mode=robot, safety_mode=safety
    )
    packet = packet[:1052] + struct.pack(">d", program) + packet[1060:]
    state = parse_packet(packet)
    assert (state.t_s, state.target_rad, state.actual_rad) == (1.5, q, v)
    assert (state.target_rad_s, state.actual_rad_s) == (v, q)
    assert (state.robot_mode, state.safety_mode, state.runtime_state) == (robot, safety, program)


@given(st.binary(max_size=310), st.booleans())
@example(b"\1" * 297, True)
def test_any_bytes_as_data(data: bytes, numbered: bool) -> None:
    try:
        state = parse_data(data, 1, numbered=numbered)
    except ProtocolError:
        return
    assert all(map(math.isfinite, state.actual_rad))


@pytest.mark.parametrize("field", range(25))
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e9])
def test_numbers_that_no_arm_has(field: int, bad: float) -> None:
    data = bytearray(rtde(1.0))
    if field or not math.isfinite(bad):  # a clock may be late
        struct.pack_into(">d", data, 1 + 8 * field, bad)
        with pytest.raises(ProtocolError):
            parse_data(bytes(data), 1, numbered=True)


@given(st.integers(0, 8 * 297 - 1), st.booleans())
def test_a_wrong_bit_is_seen_or_does_not_matter(bit: int, first: bool) -> None:
    """One of two packages has a wrong bit: an accepted state is true to 1e-4 rad."""
    good = [rtde(1.0), rtde(1.008)]
    bad = bytearray(good[0 if first else 1])
    bad[bit // 8] ^= 1 << bit % 8
    packages = [bytes(bad), good[1]] if first else [good[0], bytes(bad)]
    try:
        before, now = (parse_data(package, 1, numbered=True) for package in packages)
        if not agree(before, now):
            return
    except ProtocolError:
        return
    assert now.off_rad((0.5,) * 6) <= 1.001e-4
    assert max(abs(q - 0.5) for q in now.target_rad) <= 1.001e-4
    assert (now.robot_mode, now.safety_mode, now.runtime_state) == (7, 1, 1)
    assert (now.echo, now.arguments) == (3, ARGUMENTS)


@given(
    st.sampled_from([b"", encode(b"S"[0], b"\1"), encode(b"S"[0], b"\1") + encode(b"U"[0], rtde(1.0))]),
    st.one_of(
        st.binary(max_size=230),
        st.binary(max_size=216).map(lambda body: encode(b"U"[0], b"\1" + body)),
        st.tuples(st.sampled_from(b"VvOISPUM"), st.binary(max_size=20)).map(lambda each: encode(*each)),
    ),
)
def test_any_bytes_of_an_rtde_stream(head: bytes, tail: bytes) -> None:
    """A single state is never accepted, and no bytes after it form the next state."""
    stream = Rtde(TcpLink(Address("h", 1), "ur"), UrDeadlines(reply_s=5.0))
    stream._recipe, stream._echoed = 1, True
    with hearing(stream._link, head + tail), pytest.raises(LinkError), stream.watch("position") as witness:
        witness.state()


@given(st.binary(max_size=80))
def test_any_bytes_as_the_beginning_of_rtde(data: bytes) -> None:
    stream = Rtde(TcpLink(Address("h", 1), "ur"), UrDeadlines(reply_s=5.0))
    with hearing(stream._link, data), pytest.raises(LinkError):
        stream.open()


def states(*packets: bytes) -> StateConfirmer:
    queue = [parse_packet(packet) for packet in packets]

    def read() -> UrState:
        return queue.pop(0)

    return StateConfirmer(read)


def test_a_moving_arm_is_believed_when_its_speed_explains_the_way() -> None:
    moving = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    near, far = (0.508, *(0.5,) * 5), (0.6, *(0.5,) * 5)
    assert states(at(1.0, v=moving), at(1.008, near, moving)).state().actual_rad == near
    believed = states(
        at(1.0, v=moving), at(1.008, far, moving), at(1.016, (0.508, *(0.5,) * 5), moving), at(1.1)
    )
    assert believed.state().t_s == 1.1


@pytest.mark.parametrize("later", [1.0, 0.992])
def test_a_clock_that_stands_or_goes_back(later: float) -> None:
    with pytest.raises(ProtocolError, match="clock"):
        states(at(1.0), at(later)).state()


def test_states_that_never_agree() -> None:
    jumping = [at(1.0 + i, (0.1 * (i % 2),) * 6) for i in range(300)]
    with pytest.raises(ProtocolError, match="agree"):
        states(*jumping).state()


@given(st.binary(max_size=60))
def test_any_bytes_as_text(data: bytes) -> None:
    try:
        assert ": " in parse_text(data)
    except ProtocolError:
        return


def test_text_of_the_guide() -> None:
    assert parse_text(b"\x05hello\x04RTDE\x02") == "RTDE: hello"
    assert parse_text(b"\x05\x1b[2J\x07\x04RTDE\x02").isprintable()  # a terminal would clear its screen


@given(st.one_of(st.binary(max_size=200), st.binary(min_size=300, max_size=900)))
def test_any_bytes_on_the_secondary_port(data: bytes) -> None:
    for parser in (split_packages, parse_version, parse_configuration, parse_kinematics):
        try:
            parser(data)
        except ProtocolError:
            continue


def test_descriptions_of_the_simulator_are_read() -> None:
    nominal = Dh(theta=(0.0,) * 6, a=(0, -0.425, -0.392, 0, 0, 0), d=(0.0891,) * 6, alpha=(math.pi / 2,) * 6)
    parts = dict(split_packages(configuration(1, [(-6.28, 6.28)] * 6, nominal) + kinematics(nominal)))
    model, numbers = parse_configuration(parts[6])
    assert model == "UR5"
    for kind, name in ((4, "UR16e"), (7, "UR20"), (8, "UR30")):
        large = dict(split_packages(configuration(kind, [(-6.28, 6.28)] * 6, nominal)))
        assert parse_configuration(large[6])[0] == name
    assert numbers.a_mm == pytest.approx((0, -425.0, -392.0, 0, 0, 0))
    assert numbers.alpha_deg == pytest.approx((90.0,) * 6)
    assert parse_kinematics(parts[5])[0] == numbers
    message = version_message((3, 15, 8, 1))
    assert parse_version(message[5:]) == "3.15.8"
    assert parse_version(package(20, bytes(12))[5:]) is None


@given(ANGLES, st.floats(0.01, 10), st.floats(0.01, 3), st.one_of(st.none(), st.integers(1, 2**31 - 1)))
def test_programs_are_understood_by_the_simulator(
    goal: tuple[float, ...], acceleration: float, speed: float, number: int | None
) -> None:
    program = UrScriptMove(goal, acceleration, speed, number, 2.0)
    (lines,) = ScriptReader().feed(program.text().encode())
    *first, move = parse_program(lines)
    assert move.arguments["q"] == pytest.approx(goal, abs=1e-8)
    assert (move.arguments["a"], move.arguments["v"]) == pytest.approx((acceleration, speed), abs=1e-6)
    if number is None:
        assert first == []
        return
    watchdog, *shown, echo, wait = first
    assert watchdog.arguments["min_frequency"] == 0.5
    assert [call.arguments["output_register"] for call in shown] == list(range(24, 34))
    assert tuple(call.arguments["value"] for call in shown) == program.arguments
    assert echo.arguments == {"output_register": 46, "value": number}
    assert wait.arguments == {"input_register": 47, "value": number}


@given(st.integers(0, 10_000), st.integers(1, 9))
def test_a_digit_of_a_program_that_is_wrong_is_told_or_does_not_move_elsewhere(place: int, by: int) -> None:
    """No wrong digit moves the arm elsewhere.

    The program is not run, or reports a value that the driver did not send, or moves as it must.
    """
    program = UrScriptMove((0.5, -0.25, 1.125, 0.0, -3.0, 6.28), 1.047198, 0.349066, 17, 2.0)
    text = program.text()
    digits = [i for i, character in enumerate(text) if character.isdecimal()]
    at = digits[place % len(digits)]
    spoiled = text[:at] + str((int(text[at]) + by) % 10) + text[at + 1 :]
    assert not elsewhere(program, spoiled)


@pytest.mark.parametrize("bit", range(7))
def test_a_bit_of_a_program_that_is_wrong_is_told_or_does_not_move_elsewhere(bit: int) -> None:
    program = UrScriptMove((0.5, -0.25, 1.125, 0.0, -3.0, 6.28), 1.047198, 0.349066, 17, 2.0)
    text = program.text()
    for at, character in enumerate(text):
        spoiled = text[:at] + chr(ord(character) ^ (1 << bit)) + text[at + 1 :]
        assert not elsewhere(program, spoiled), spoiled


def elsewhere(program: UrScriptMove, text: str) -> bool:
    """Report whether a controller moves to another target or at another speed than it reports.

    The report must be the one that the driver expects.
    """
    try:
        calls = [
            call for lines in ScriptReader().feed(text.encode("latin-1")) for call in parse_program(lines)
        ]
    except ScriptError:
        return False
    shown = {call.arguments["output_register"]: call.arguments["value"] for call in calls if "value" in call.arguments
            and "output_register" in call.arguments}  # fmt: skip
    expected = dict(enumerate(program.arguments, start=24)) | {46: program.number}
    if any(shown.get(register) != value for register, value in expected.items()):
        return False
    moves = [call.arguments for call in calls if call.name == "movej"]
    wanted = program.arguments[:6], program.arguments[6], program.arguments[7]
    return any((tuple(move["q"]), move["a"], move["v"]) != wanted for move in moves)


@given(st.text(max_size=40))
@example("movej([0,0,0,0,0,0],v=1,w=2)")
@example("movej()")
@example("stopj(2.0, 3.0)")
@example("a.b(1)")
@example("movej(__import__('os'))")
def test_any_text_as_a_call(text: str) -> None:
    with pytest.raises(ScriptError):
        parse_call(text)
