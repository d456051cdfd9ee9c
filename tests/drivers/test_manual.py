"""Entries that a person types.

They are taken as typed, requested again if they cannot be right, and questioned if they look wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from drivers import CannotStop, JointLimit, LeftOut, ManualArm, ManualMeter, NoOperator, NotArmed, TypedEntry
from drivers.manual.meter import ENOUGH, InvalidEntry, rows_of, slip_of

AXES = ("x", "y", "z")
LIMITS = [(-170.0, 170.0)] * 7
TARGET = [12.3456, -45.678, 30.0, -91.234, 60.049, 7.891, 0.0]
SHOWN = "12.35 -45.68 30.00 -91.23 60.05 7.89 0.00"


class Person:
    """Person who types the listed answers in turn, and remembers the questions."""

    def __init__(self, *typed: str) -> None:
        self.typed = list(typed)
        self.asked: list[tuple[str, TypedEntry, str]] = []

    def __call__(self, text: str, entry: TypedEntry, picture: str) -> str:
        self.asked.append((text, entry, picture))
        return self.typed.pop(0)

    @property
    def pictures(self) -> list[str]:
        return [picture for _, _, picture in self.asked]


def an_arm(person: Person, **options: Any) -> ManualArm:
    arm = ManualArm(limits_deg=LIMITS, **options)
    arm.attend(person)
    arm.connect()
    arm.arm()
    return arm


def a_meter(person: Person, unit: str = "mm") -> ManualMeter:
    meter = ManualMeter(unit=unit, within_mm=50.0)
    meter.attend(person)
    meter.connect()
    meter.arm()
    return meter


@pytest.mark.parametrize(
    "text",
    [
        "1234.5 -67.8 9",
        "1234,5 -67,8 9",
        "1234,5; -67,8; 9",
        "1234.5, -67.8, 9",
        "1234,5, -67,8, 9",
        "X=1234.5 Y=-67.8 Z=9",
        "x: 1234.5\ty: \u221267.8\tz: 9",
        "X 1234.5 mm\nY -67.8 mm\nZ 9 mm",
        "  +1234.50mm | -67.80mm | 9.0mm ",
    ],
)
def test_numbers_as_people_write_them(text: str) -> None:
    (row,) = rows_of(text, AXES, "mm")
    assert row.values == (1234.5, -67.8, 9.0)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "count"),
        ("1 2", "count"),
        ("1 2 3 4", "count"),
        ("1,2,3", "mixed"),
        ("1.234,5 6 7", "mixed"),
        ("1,234.5 6 7", "mixed"),
        ("1.234.567 6 7", "mixed"),
        ("1.5 2,5 3", "mixed"),
        ("1 2 three", "text"),
        ("1 2 nan", "text"),
        ("1e3 2 3", "unit"),
        ("1m 2 3", "unit"),
        ('1" 2 3', "unit"),
        ("Y 1 X 2 Z 3", "order"),
        ("1 2 99999999", "text"),
        ("9" * 3000, "count"),
    ],
)
def test_what_could_mean_two_things_is_refused(text: str, reason: str) -> None:
    with pytest.raises(InvalidEntry) as caught:
        rows_of(text, AXES, "mm")
    assert caught.value.reason == reason


def test_confirm_alone_is_the_target_as_the_pendant_shows_it() -> None:
    person = Person("")
    reached = an_arm(person).move_to(TARGET)
    assert reached.joints_deg == tuple(map(float, SHOWN.split()))
    ((text, entry, picture),) = person.asked
    assert entry.shown == tuple(SHOWN.split())
    assert (entry.needed, picture) == (False, "drive")
    assert "J1 12.35" in text


def test_the_whole_way_is_told_in_one_question() -> None:
    person = Person("")
    an_arm(person).move_over([[1.0] * 7, [2.0] * 7], TARGET)
    ((text, _, _),) = person.asked
    assert text.index("J1 1.00") < text.index("J1 2.00") < text.index("J1 12.35")


def test_what_the_pendant_shows_counts_within_what_is_allowed() -> None:
    typed = SHOWN.replace("30.00", "30.41")
    assert an_arm(Person(typed), within_deg=0.5).move_to(TARGET).joints_deg[2] == 30.41
    person = Person(typed, "")
    assert an_arm(person).move_to(TARGET).joints_deg[2] == 30.0
    assert person.pictures == ["drive", "drive/again/far/J3"]


@pytest.mark.parametrize(
    ("shown", "typed", "reason"),
    [
        ("-91.23", "91.23", "sign"),
        ("12.35", "12.53", "swap"),
        ("60.05", "600.5", "point"),
        ("60.05", "66.05", "digit"),
        ("60.05", "6.05", "digit"),
        ("60.05", "160.05", "digit"),
        ("12.35 -45.68", "-45.68 12.35", "order"),
    ],
)
def test_a_slip_at_the_pendant_is_named(shown: str, typed: str, reason: str) -> None:
    person = Person(SHOWN.replace(shown, typed), SHOWN)
    assert an_arm(person, within_deg=0.1).move_to(TARGET).joints_deg == tuple(map(float, SHOWN.split()))
    assert person.pictures[1].split("/")[:3] == ["drive", "again", reason]


def test_a_slip_within_what_is_allowed_is_taken_when_it_is_said_twice() -> None:
    typed = SHOWN.replace("12.35", "12.53")
    for second in (typed, ""):
        person = Person(typed, second)
        assert an_arm(person, within_deg=0.5).move_to(TARGET).joints_deg[0] == 12.53
        assert person.pictures[1] == "drive/again/swap/J1"


def test_nothing_is_asked_before_arming_or_beyond_the_limits() -> None:
    person = Person()
    arm = ManualArm(limits_deg=LIMITS)
    arm.attend(person)
    with pytest.raises(NotArmed):
        arm.move_to(TARGET)
    arm.arm()
    with pytest.raises(JointLimit):
        arm.move_to([171.0, *TARGET[1:]])
    with pytest.raises(JointLimit):
        arm.move_over([[0.0] * 6 + [-171.0]], TARGET)
    with pytest.raises(NoOperator):
        ManualArm(limits_deg=LIMITS).position()
    assert person.asked == []


def test_it_cannot_be_stopped_and_says_so() -> None:
    arm = an_arm(Person(""))
    with pytest.raises(CannotStop, match="moved by hand: Stop does not reach it"):
        arm.stop()
    assert not arm.can_stop
    with pytest.raises(NotArmed):
        arm.move_to(TARGET)


def test_where_it_is_is_asked_once_and_again_after_somebody_may_have_moved_it() -> None:
    person = Person(SHOWN, SHOWN)
    arm = an_arm(person)
    assert arm.position() == arm.position()
    arm.disarm()
    arm.position()
    assert person.pictures == ["pendant", "pendant"]


def test_a_person_who_skips_is_heard() -> None:
    def skips(text: str, entry: TypedEntry, picture: str) -> str:
        raise LeftOut("no room", device="operator")

    arm = an_arm(Person())
    arm.attend(skips)
    with pytest.raises(LeftOut):
        arm.move_to(TARGET)


def test_several_readings_are_one_with_their_scatter() -> None:
    reading = a_meter(Person("1 2 3\n1.02 2 3\n0.98 2 3")).measure("T1")
    assert reading.xyz_mm == pytest.approx((1.0, 2.0, 3.0))
    assert reading.std_mm == pytest.approx((0.02, 0.0, 0.0))
    assert reading.samples == 3
    person = Person("1 2 3\n1 2 30", "1 2 3")
    assert a_meter(person).measure("T1").samples == 1
    assert person.pictures == ["read/T1", "read/T1/again/rows"]
    person = Person("1 2 3\n1 2 3.03", "1 2 3")  # 15 mm from their mean, on a display in metres
    assert a_meter(person, "m").measure("T1").samples == 1
    assert person.pictures == ["read/T1", "read/T1/again/rows"]


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("m", 1000.0), ("in", 25.4)])
def test_units(unit: str, mm: float) -> None:
    assert a_meter(Person("1 -2 0,5"), unit).measure("T1").xyz_mm == pytest.approx((mm, -2 * mm, 0.5 * mm))


def slips(point: Sequence[str]) -> dict[str, list[str]]:
    x, y, z = point
    digits = next(i for i in range(len(x) - 1) if x[i : i + 2].isdigit() and x[i] != x[i + 1])
    return {
        "order": [y, x, z],
        "sign": [x, y.lstrip("-") if y.startswith("-") else f"-{y}", z],
        "swap": [x[:digits] + x[digits + 1] + x[digits] + x[digits + 2 :], y, z],
        "unit": [f"{float(each) / 1000.0:.6f}" for each in point],
        "digit": [x, y, f"{(int(z[0]) + 1) % 10}{z[1:]}"],
    }


@pytest.mark.parametrize("kind", ["order", "sign", "swap", "unit", "digit"])
def test_a_slip_at_the_instrument_is_named_once_enough_is_known(kind: str) -> None:
    """Random slips of the hand on points that a turned, shifted and erring robot reaches."""
    rng = np.random.default_rng(7)
    shift = np.array([20.0, -10.0, 5.0])
    near = rng.uniform(-900.0, 900.0, size=(60, 3)) + np.array([2000.0, 1500.0, 3000.0])
    seen = near + 0.02 * shift
    seen = seen + rng.normal(scale=0.5, size=seen.shape)
    named = 0
    meter = a_meter(Person())
    for number, (a, b) in enumerate(zip(near, seen, strict=True)):
        point = [f"{x:.3f}" for x in b]
        wrong = slips(point)[kind] if number >= ENOUGH else point
        person = Person(" ".join(wrong), " ".join(point), " ".join(point))
        meter.attend(person)
        assert meter.measure("T1", near_mm=tuple(a)).xyz_mm == pytest.approx(tuple(map(float, point)))
        if number >= ENOUGH:
            off = np.linalg.norm([float(w) - p for w, p in zip(wrong, b, strict=True)])
            assert len(person.asked) == 2 or off < 5.0
            named += len(person.asked) == 2 and person.pictures[1].split("/")[3] == kind
    assert named >= 0.9 * (len(near) - ENOUGH)


def test_what_no_slip_explains_is_only_said_to_be_far() -> None:
    person = Person("5.37 2.11 3.29", "1 2 3")
    a_meter(person, "m").measure("T1", near_mm=(1000.0, 2000.0, 3000.0))
    assert person.pictures[1] == "read/T1/again/far"


@pytest.mark.parametrize(
    ("typed", "meant", "reason"),
    [
        ("123.4 5 6", (128.4, 5.0, 6.0), "digit"),  # and not 127.4, which is within the tolerance as well
        ("57.2958 28.6479 114.5916", (1.0, 0.5, 2.0), "unit"),
        ("1 0.5 2", (57.2958, 28.6479, 114.5916), "unit"),
    ],
)
def test_the_nearest_slip_is_named(typed: str, meant: tuple[float, ...], reason: str) -> None:
    (row,) = rows_of(typed, AXES, "mm")
    slip = slip_of(row, meant, 1.0)
    assert slip is not None
    assert slip.reason == reason
    assert slip.meant == pytest.approx(meant, abs=1e-3)


def test_a_point_elsewhere_is_taken_when_it_is_confirmed() -> None:
    answers: list[Callable[[], Person]] = [
        lambda: Person("500 0 0", ""),
        lambda: Person("500 0 0", "500 0 0"),
    ]
    for answer in answers:
        person = answer()
        assert a_meter(person).measure("T1", near_mm=(0.0, 0.0, 0.0)).xyz_mm == (500.0, 0.0, 0.0)
        assert len(person.asked) == 2
    person = Person("500 0 0", "300 0 0", "1 0 0")  # another one is asked about as well
    assert a_meter(person).measure("T1", near_mm=(0.0, 0.0, 0.0)).xyz_mm == (1.0, 0.0, 0.0)
    assert len(person.asked) == 3


def test_whoever_reads_is_named_as_what_it_is() -> None:
    meter = a_meter(Person("1 2 3"))
    assert "typed by a person" in meter.weakness
    assert meter.identify().protocol == "by hand"
    assert meter.status().state == "READY"
    meter.stop()
    with pytest.raises(NotArmed):
        meter.measure("T1")
