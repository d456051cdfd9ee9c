"""Arbitrary answers of the instruments.

The driver returns a finite reading of the requested target, or raises an error of ours.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from xml.sax.saxutils import escape

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import (
    AcquisitionError,
    ConfigError,
    CTrack,
    EmsconTracker,
    FaroTracker,
    LeicaTracker,
    LengthReading,
    PointReading,
    Qc20w,
)
from drivers.bridge.session import MbpSession
from drivers.renishaw.b5r import parse_b5r
from drivers.renishaw.qc20w import BarCalibration
from tests.drivers.hearing import hearing

URL = "tcp://127.0.0.1:1"
BAR = BarCalibration(300.0, 1.0, 1e-3, 0.0, "", "", "")
COMMON = {"n": "10", "t": "12.5", "age": "0.0", "status": "0", "temp": "21.9", "target": "T1"}
STD = {"sx": "0.01", "sy": "0.02", "sz": "0.01"}
POINT = {**COMMON, **STD, "x": "300.0", "y": "400.0", "z": "0.0", "r": "500.0", "P": "1013.2", "H": "45.0"}
TURN = {"q0": "1.0", "q1": "0.0", "q2": "0.0", "q3": "0.0", "srot": "0.1", "model": "T1", "ref": "base"}
SEEN = {"frames": "10", "visible": "9", "rvisible": "16"}
POSE = {**COMMON, **STD, **TURN, **SEEN, "x": "300.0", "y": "400.0", "z": "0.0"}
LENGTH = {**COMMON, "d": "0.0123", "sd": "0.001", "over": "0", "base": "B1", "batt": "80"}

TEXTS = st.one_of(
    st.floats().map(repr),
    st.integers(-20, 20).map(str),
    st.text("0123456789+-.einfaINFA_", min_size=1, max_size=8),
    st.sampled_from(["T1", "T2", "base", "0", "1", "10", "1e999", '""']),
)


def changed(good: Mapping[str, str]) -> st.SearchStrategy[bytes]:
    """A good answer with some fields of any content, and some left out."""
    keys = st.sampled_from(sorted(good))
    return st.builds(
        lambda other, gone: " ".join(
            ["1 OK", *(f"{k}={v}" for k, v in {**good, **other}.items() if k not in gone)]
        ).encode("ascii"),
        st.dictionaries(keys, TEXTS, max_size=3),
        st.sets(keys, max_size=1),
    )


def heard(
    session: MbpSession, answer: bytes, ask: Callable[[], PointReading | LengthReading]
) -> PointReading | LengthReading | None:
    """Return the reading that a driver makes of an answer, or None for an error of ours.

    Any other error fails the test.
    """
    session.armed = True
    with hearing(session.client.link, answer + b"\n"):  # type: ignore[arg-type]
        try:
            return ask()
        except AcquisitionError:
            return None


def all_finite(reading: PointReading | LengthReading) -> bool:
    if isinstance(reading, LengthReading):
        return all(map(math.isfinite, (reading.length_mm, reading.std_mm, reading.t_s)))
    return all(map(math.isfinite, (*reading.xyz_mm, *reading.std_mm, reading.t_s)))


def point(answer: bytes, tracker: FaroTracker | LeicaTracker) -> PointReading | LengthReading | None:
    return heard(tracker.session, answer, lambda: tracker.measure("T1", samples=10))


def pose(answer: bytes) -> PointReading | LengthReading | None:
    meter = CTrack(URL, heartbeat_s=None)
    meter._bodies = {"T1": 9, "base": 16}
    return heard(meter.session, answer, lambda: meter.measure("T1", samples=10))


def length(answer: bytes) -> PointReading | LengthReading | None:
    meter = Qc20w(URL, nominal_mm=300.0, heartbeat_s=None)
    meter.calibration = BAR
    return heard(meter.session, answer, lambda: meter.measure("T1", base_target="B1", samples=10))


@given(changed(POINT))
def test_any_fields_of_a_point(answer: bytes) -> None:
    for tracker in (FaroTracker(URL, heartbeat_s=None), LeicaTracker(URL, heartbeat_s=None)):
        reading = point(answer, tracker)
        if reading is not None:
            assert all_finite(reading)
            assert b"target=T1" in answer or b"target=" not in answer


@given(changed(POSE))
def test_any_fields_of_a_pose(answer: bytes) -> None:
    reading = pose(answer)
    if reading is not None:
        assert all_finite(reading)
        assert b"model=T1" in answer


@given(changed(LENGTH))
def test_any_fields_of_a_length(answer: bytes) -> None:
    reading = length(answer)
    if reading is not None:
        assert all_finite(reading)


@given(st.one_of(st.binary(max_size=200), st.binary(max_size=60).map(lambda rest: b"1 OK x=" + rest)))
def test_any_bytes_of_a_bridge(answer: bytes) -> None:
    assert point(answer, FaroTracker(URL, heartbeat_s=None)) is None
    assert pose(answer) is None
    assert length(answer) is None


def line(fields: Mapping[str, str]) -> bytes:
    return " ".join(["1 OK", *(f"{k}={v}" for k, v in fields.items())]).encode("ascii")


@pytest.mark.parametrize(("age", "good"), [("-0.001", False), ("0.0", True), ("1.0", True), ("1.001", False)])
def test_a_reading_is_neither_old_nor_from_the_future(age: str, good: bool) -> None:
    for reading in (
        point(line({**POINT, "age": age}), FaroTracker(URL, heartbeat_s=None)),
        point(line({**POINT, "age": age}), LeicaTracker(URL, heartbeat_s=None)),
        pose(line({**POSE, "age": age})),
        length(line({**LENGTH, "age": age})),
    ):
        assert (reading is not None) == good


def test_the_unchanged_answers_are_readings() -> None:
    for reading in (
        point(line(POINT), FaroTracker(URL, heartbeat_s=None)),
        point(line(POINT), LeicaTracker(URL, heartbeat_s=None)),
        pose(line(POSE)),
    ):
        assert isinstance(reading, PointReading)
        assert reading.xyz_mm == (300.0, 400.0, 0.0)
    bar = length(line(LENGTH))
    assert isinstance(bar, LengthReading)
    assert bar.length_mm == pytest.approx(300.0123)


def emscon(*packets: bytes) -> PointReading | None:
    tracker = EmsconTracker(URL)
    tracker._armed, tracker._time_ms = True, 500
    with hearing(tracker._link, *packets):
        try:
            return tracker.measure("T1", samples=10)
        except AcquisitionError:
            return None


READY, STARTED = struct.pack("<5i", 20, 0, 2, 0, 2), struct.pack("<4i", 16, 0, 49, 0)


@given(
    st.lists(st.floats(), min_size=17, max_size=17), st.sampled_from([0, 0, 0, 1, 2, 4]), st.integers(0, 1)
)
def test_any_numbers_of_emscon(values: list[float], status: int, mode: int) -> None:
    packet = struct.pack("<5i17d", 156, 2, status, mode, 0, *values)
    reading = emscon(READY, STARTED + packet)
    if reading is not None:
        assert (status, mode) == (0, 0)
        assert all_finite(reading)
        assert math.hypot(*reading.xyz_mm) >= 1.0


@given(st.sampled_from([READY, STARTED, b""]), st.binary(max_size=60), st.binary(max_size=170))
def test_any_bytes_of_emscon(head: bytes, first: bytes, second: bytes) -> None:
    assert emscon(head + first) is None
    assert emscon(READY, STARTED + second) is None


def test_the_packet_of_a_measurement_is_a_reading() -> None:
    values = (300.0, 400.0, 0.0, 0.01, 0.02, 0.01, 0.03, *(0.0,) * 7, 20.0, 1013.2, 50.0)
    reading = emscon(READY, STARTED + struct.pack("<5i17d", 156, 2, 0, 0, 0, *values))
    assert reading is not None
    assert reading.xyz_mm == (300.0, 400.0, 0.0)


TAGS = ("PLANE", "FEATURE", "ANALYSIS", "OPERATOR", "MACHINE_TESTED", "TEST_SPEC")


@given(
    st.lists(st.tuples(st.sampled_from(TAGS), st.one_of(TEXTS, st.text(max_size=5))), max_size=8), st.data()
)
def test_any_elements_of_a_ballbar_file(elements: list[tuple[str, str]], data: st.DataObject) -> None:
    inside = "".join(f'<{tag} NAME="F">{escape(text)}</{tag}>' for tag, text in elements)
    coding = data.draw(st.sampled_from(["utf-8", "utf-16", "latin-1"]))
    try:
        test = parse_b5r(f"<A>{inside}</A>".encode(coding, "replace"))
    except ConfigError:
        return
    assert all(math.isfinite(each.value) for each in test.features)
