"""An instrument that a person reads: x, y, z in its own frame are typed or pasted.

Several rows at once are readings of one point: their mean counts, and their scatter is kept. Numbers may have a decimal
comma or point, names and units. Ambiguous text is refused with the reason, never guessed.

The point is predicted from the nominal robot and the readings before it. The nominal robot errs by millimetres and its
place in the cell file by more. Earlier readings determine their common error, the rigid motion that moves predicted
points onto them (Kabsch; Umeyama, PAMI 13, 1991). The rest is the error of the robot and of the tool. A point that is
off by much more was mistyped: it is requested again, with the slip of the hand that would explain it. If it is typed
in the same way again, or confirmed, it is accepted.

    order   two numbers exchanged           sign    one of them with the other sign
    swap    two neighbouring digits          digit   a digit missing, doubled or another one
    point   the decimal point elsewhere      unit    all numbers in another unit

A slip is only named if the numbers are off, and would be within the tolerance without it. Lengths in mm.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from statistics import fmean, stdev

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigError, NoOperator, NotArmed
from drivers.interfaces import Asking, Identity, InstrumentStatus, PointReading, TypedEntry
from drivers.link import WireSink

MOST_CHARACTERS = 2000

MOST_ROWS = 20

_LARGEST = 1e6

_NUMBER = re.compile(r"[+-]?\d{1,9}(?:[.,]\d{1,12})?")

_SEPARATORS = re.compile(r"[\s;|]+|,(?=\s)")

_NAMED = re.compile(r"(?P<name>[A-Za-z]\w{0,15})[:=](?P<rest>.*)")

_MM = {"mm": 1.0, "m": 1000.0, "in": 25.4}

UNITS: dict[str, tuple[str, ...]] = {unit: (unit,) for unit in _MM} | {
    "deg": ("deg", "°"),
    "deg or mm": ("deg", "°", "mm"),
}

"""What may stand behind numbers in each unit."""

MM_OF = _MM

"""Millimetres in one of each unit of length."""


@dataclass(eq=False)
class InvalidEntry(Exception):
    """An entry that cannot be accepted as it was typed.

    Attributes
    ----------
    reason
        A word for tables of texts.
    name
        Name of the number.
    words
        The reason in full.
    """

    reason: str
    name: str
    words: str


@dataclass(frozen=True)
class TypedRow:
    """A row that was typed: its numbers, and each as text with a decimal point."""

    values: tuple[float, ...]
    texts: tuple[str, ...]


def rows_of(text: str, names: Sequence[str], unit: str) -> list[TypedRow]:
    """Parse the rows of a text, one number per name.

    Raises
    ------
    InvalidEntry
        The text is ambiguous, or has another count of numbers.
    """
    if len(text) > MOST_CHARACTERS:
        raise InvalidEntry("count", "", f"more than {MOST_CHARACTERS} characters were typed")
    tokens = [token for token in _SEPARATORS.split(text.replace("\u2212", "-").strip()) if token]
    numbers: list[str] = []
    for token in _apart(tokens, names):
        name = names[len(numbers) % len(names)]
        if token.casefold().rstrip(".") in UNITS[unit] and numbers:
            continue
        if token in names:  # "X 12.5 Y 3.0"
            _refuse_order(token, name)
            continue
        numbers.append(_number(token, name, unit))
    if not numbers or len(numbers) % len(names) or len(numbers) > MOST_ROWS * len(names):
        raise InvalidEntry(
            "count",
            "",
            f"{len(numbers)} {'number was' if len(numbers) == 1 else 'numbers were'} typed, "
            f"{len(names)} are needed ({', '.join(names)})",
        )
    if any("," in number for number in numbers) and any("." in number for number in numbers):
        raise InvalidEntry("mixed", "", "some numbers have a decimal comma and others a decimal point")
    texts = [number.replace(",", ".") for number in numbers]
    width = len(names)
    return [
        TypedRow(tuple(map(float, texts[i : i + width])), tuple(texts[i : i + width]))
        for i in range(0, len(texts), width)
    ]


def _apart(tokens: Sequence[str], names: Sequence[str]) -> list[str]:
    """Split `x=12.5` into `x` and `12.5`, with names in their requested form."""
    asked = {name.casefold(): name for name in names}
    found: list[str] = []
    for token in tokens:
        match = _NAMED.fullmatch(token)
        parts = [match["name"], match["rest"]] if match else [token]
        found += [asked.get(part.casefold(), part) for part in parts if part and part not in ":="]
    return found


def _refuse_order(token: str, name: str) -> None:
    if token != name:
        raise InvalidEntry("order", name, f"{token} stands where {name} belongs")


def _number(token: str, name: str, unit: str) -> str:
    for behind in UNITS[unit]:
        if token.endswith(behind) and _NUMBER.fullmatch(token.removesuffix(behind)):
            token = token.removesuffix(behind)
    if "." in token and "," in token:
        raise InvalidEntry(
            "mixed", name, f"{token!r} has a comma and a point: type it without thousands separators"
        )
    if token.count(",") > 1 or token.count(".") > 1:
        raise InvalidEntry(
            "mixed", name, f"{token!r}: put a blank between numbers, and no thousands separators"
        )
    match = re.match(r"[+-]?[\d.,]{1,24}", token)
    if match and not _NUMBER.fullmatch(token) and _NUMBER.fullmatch(match[0]):
        raise InvalidEntry("unit", name, f"{token!r} is not in {unit}")
    if not _NUMBER.fullmatch(token):
        raise InvalidEntry("text", name, f"{token!r} is not a number")
    if abs(float(token.replace(",", "."))) > _LARGEST:
        raise InvalidEntry("text", name, f"{token} is too large to be a reading")
    return token


_AXES = ("x", "y", "z")

_ONE_POINT_MM = 1.0  # rows of one point lie closer together

_UNITS = (1000.0, 0.001, 25.4, 1.0 / 25.4, math.degrees(1.0), math.radians(1.0))

ENOUGH = 8

_TIMES = 5.0  # the scatter, per axis, of the readings so far

_LEAST_MM = 2.0

_SPREAD_MM = 50.0  # of predicted points along their second axis: below, they fix no turn

Points = NDArray[np.float64]


class ManualMeter:
    """An instrument that a person reads.

    Parameters
    ----------
    unit
        Unit of its display: mm, m or in.
    within_mm
        Largest permitted distance of a point from its expected place, mm.
    """

    unverified_on_hardware = True
    weakness = "its readings are typed by a person"

    def __init__(
        self,
        url: str = "",
        *,
        name: str = "manual",
        unit: str = "mm",
        within_mm: float = 50.0,
        serial: str = "",
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if unit not in MM_OF:
            raise ConfigError(
                f"unit {unit!r} is none of {', '.join(MM_OF)}", device=name, what_to_do="Use one of them."
            )
        self.name = name
        self._unit = unit
        self._mm = MM_OF[unit]
        self._prediction = Prediction(within_mm)
        self._serial = serial
        self._wire = wire
        self._clock = clock
        self._questions = Questions(name)
        self._armed = False

    def attend(self, ask: Asking) -> None:
        """Put questions to a person through `ask` from now on."""
        self._questions.attend = ask

    def connect(self) -> None:
        """Do nothing, because a manual instrument has no connection."""
        self._armed = False

    def disconnect(self) -> None:
        """Disarm; never raises."""
        self._armed = False

    def identify(self) -> Identity:
        """Return the serial number of the cell file; maker and model are unknown."""
        return Identity("", "", self._serial, "", "by hand")

    def arm(self) -> None:
        """Allow prompts for readings."""
        self._armed = True

    def disarm(self) -> None:
        """Allow no prompts until armed again; never raises."""
        self._armed = False

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PointReading:
        """Have a person read a point of a target and type it.

        The number of samples is the number of typed readings, independently of `samples`. Errors of the question are
        passed on.

        Raises
        ------
        NotArmed
            The instrument is not armed.
        NoOperator
            There is no person to ask.
        LeftOut
            The person skipped the question.
        """
        if not self._armed:
            raise NotArmed("not armed", device=self.name, command="measure")
        rows, raw = self._questions.numbers(
            f"Measure {target} and type x y z as the instrument shows them, {self._unit}; several readings of it may "
            "be pasted at once.",
            TypedEntry(_AXES, self._unit),
            f"read/{target}",
            lambda rows: self._wrong(rows, near_mm),
        )
        x, y, z = (self._mm * fmean(each) for each in zip(*(row.values for row in rows), strict=True))
        if near_mm is not None:
            self._prediction.learn(near_mm, (x, y, z))
        sx, sy, sz = self._scatter(rows)
        return PointReading(
            target=target,
            xyz_mm=(x, y, z),
            std_mm=(sx, sy, sz),
            samples=len(rows),
            t_s=self._clock(),
            age_s=0.0,
            mode="by hand",
            raw=raw,
        )

    def stop(self) -> None:
        """Do nothing: the instrument does not move, and a waiting prompt ends by itself."""
        self._armed = False

    def status(self) -> InstrumentStatus:
        """Return a status without information."""
        return InstrumentStatus("READY")

    def _scatter(self, rows: Sequence[TypedRow]) -> tuple[float, ...]:
        if len(rows) == 1:
            return 0.0, 0.0, 0.0
        return tuple(self._mm * stdev(each) for each in zip(*(row.values for row in rows), strict=True))

    def _wrong(self, rows: Sequence[TypedRow], near_mm: Sequence[float] | None) -> InvalidEntry | None:
        """Return the mistake or doubt in typed rows, or None.

        The rows must belong to one point, and the point must be where it is expected.
        """
        middle = [fmean(each) for each in zip(*(row.values for row in rows), strict=True)]
        for number, row in enumerate(rows, start=1):
            if (off := self._mm * math.dist(row.values, middle)) > _ONE_POINT_MM:
                words = f"row {number} is {off:.3f} mm from the mean of all: are these readings of one point?"
                return InvalidEntry("rows", "", words)
        if near_mm is None:
            return None
        place, within_mm = self._prediction.expect(near_mm)
        off = self._mm * math.dist(middle, [each / self._mm for each in place])
        if off <= within_mm:
            return None
        words = f"that is {off:.1f} mm from where the point should be"
        slip = slip_of(rows[0], [each / self._mm for each in place], within_mm / self._mm)
        if slip is None:
            return TypingDoubt("far", "", words)
        name = "" if slip.index is None else _AXES[slip.index]
        return TypingDoubt(slip.reason, name, f"{words}: {in_words(slip, _AXES, self._unit)}")


class Questions:
    """The prompts of a device. Before `attend` is set, there is no one to ask."""

    def __init__(self, device: str) -> None:
        self._device = device
        self.attend: Asking | None = None

    def numbers(
        self,
        text: str,
        entry: TypedEntry,
        picture: str,
        judge: Callable[[Sequence[TypedRow]], InvalidEntry | None],
    ) -> tuple[list[TypedRow], bytes]:
        """Ask until the numbers can be accepted, and return the rows and the typed text.

        There are no rows if CONFIRM alone was enough. `judge` returns the fault of the rows, or None. If it has only a
        doubt (`TypingDoubt`), the same rows are accepted when they are confirmed or typed again. Errors of the question
        are passed on.

        Raises
        ------
        NoOperator
            There is no person to ask.
        """
        if self.attend is None:
            raise NoOperator("no operator is there to answer", device=self._device, command=picture)
        words, shown, doubted = text, picture, None
        while True:
            typed = self.attend(words, entry, shown)
            try:
                if not typed.strip() and doubted is not None:
                    return doubted
                if not typed.strip() and not entry.needed:
                    return [], b""
                rows = rows_of(typed, entry.names, entry.unit)
                said = rows, typed.encode()
                wrong = judge(rows)
                if wrong is None or (
                    isinstance(wrong, TypingDoubt) and doubted is not None and doubted[0] == rows
                ):
                    return said
                doubted = said if isinstance(wrong, TypingDoubt) else None
            except InvalidEntry as error:
                wrong, doubted = error, None
            again = ""
            if doubted is not None:
                entry, again = replace(entry, needed=False), " Type it again, or confirm alone if it is so."
            end = "" if wrong.words.endswith("?") else "."
            words = f"{wrong.words[:1].upper()}{wrong.words[1:]}{end}{again} {text}"
            shown = "/".join(part for part in (picture, "again", wrong.reason, wrong.name) if part)


class TypingDoubt(InvalidEntry):
    """A doubt about numbers that look wrong but may be right."""


def in_words(slip: TypingSlip, names: Sequence[str], unit: str) -> str:
    """Return the slip as a question."""
    name = "" if slip.index is None else names[slip.index]
    meant = "" if slip.index is None else f" ({slip.meant[slip.index]:g} {unit})"
    return {
        "order": f"are two numbers exchanged, {name} and another?",
        "unit": f"are the numbers really in {unit}?",
        "sign": f"is the sign of {name} right{meant}?",
        "swap": f"are two digits of {name} exchanged{meant}?",
        "point": f"is the decimal point of {name} in its place{meant}?",
        "digit": f"is a digit of {name} wrong, missing or doubled{meant}?",
    }[slip.reason]


@dataclass(frozen=True)
class TypingSlip:
    """A slip of the hand.

    `index` is that of the number, None if it concerns all; `meant` has the intended numbers.
    """

    reason: str
    index: int | None
    meant: tuple[float, ...]


def slip_of(row: TypedRow, expected: Sequence[float], within: float) -> TypingSlip | None:
    """Return the slip that explains a row, or None.

    It is the nearest one of the likeliest kind.
    """
    for tried in (_exchanged(row), _in_another_unit(row), *_single(row)):
        fitting = [slip for slip in tried if apart(slip.meant, expected) <= within]
        if fitting:
            return min(fitting, key=lambda slip: apart(slip.meant, expected))
    return None


def apart(one: Sequence[float], other: Sequence[float]) -> float:
    """Return the largest difference of two rows."""
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def _exchanged(row: TypedRow) -> Iterator[TypingSlip]:
    for i, j in combinations(range(len(row.values)), 2):
        meant = list(row.values)
        meant[i], meant[j] = meant[j], meant[i]
        yield TypingSlip("order", i, tuple(meant))


def _in_another_unit(row: TypedRow) -> Iterator[TypingSlip]:
    for factor in _UNITS:
        yield TypingSlip("unit", None, tuple(factor * value for value in row.values))


def _single(row: TypedRow) -> tuple[list[TypingSlip], ...]:
    """Return every slip in one number, by kind, the likeliest first."""
    kinds = (("sign", _signs), ("swap", _swaps), ("point", _points), ("digit", _digits))
    return tuple(
        [
            TypingSlip(reason, i, (*row.values[:i], float(other), *row.values[i + 1 :]))
            for i, text in enumerate(row.texts)
            for other in others(text)
        ]
        for reason, others in kinds
    )


def _signs(text: str) -> Iterator[str]:
    yield text.lstrip("+-") if text.startswith("-") else f"-{text.lstrip('+')}"


def _swaps(text: str) -> Iterator[str]:
    for i in range(len(text)):
        j = i + 2 if text[i + 1 : i + 2] == "." else i + 1
        if j < len(text) and text[i].isdigit() and text[j].isdigit():
            yield f"{text[:i]}{text[j]}{text[i + 1 : j]}{text[i]}{text[j + 1 :]}"


def _points(text: str) -> Iterator[str]:
    for power in (-3, -2, -1, 1, 2, 3):
        yield repr(float(text) * 10.0**power)


def _digits(text: str) -> Iterator[str]:
    for i, sign in enumerate(text):
        for digit in "0123456789":
            yield f"{text[:i]}{digit}{text[i:]}" if sign not in "+-" else text
            if sign.isdigit():
                yield f"{text[:i]}{digit}{text[i + 1 :]}"
        if sign.isdigit() and sum(map(str.isdigit, text)) > 1:
            yield f"{text[:i]}{text[i + 1 :]}"


class Prediction:
    """The prediction of one execution.

    `within_mm` is the largest permitted distance of a point before there are enough readings.
    """

    def __init__(self, within_mm: float) -> None:
        self._within_mm = within_mm
        self._near: list[Sequence[float]] = []
        self._seen: list[Sequence[float]] = []

    def learn(self, near_mm: Sequence[float], seen_mm: Sequence[float]) -> None:
        """Add an accepted point, and its place according to the nominal robot."""
        self._near.append(near_mm)
        self._seen.append(seen_mm)

    def expect(self, near_mm: Sequence[float]) -> tuple[tuple[float, ...], float]:
        """Return the expected place of a point, and its largest permitted distance from there."""
        near, seen = np.array(self._near).reshape(-1, 3), np.array(self._seen).reshape(-1, 3)
        if len(near) < ENOUGH or np.linalg.svd(near - near.mean(axis=0))[1][1] < _SPREAD_MM:
            return tuple(near_mm), self._within_mm
        turn, shift = carried(near, seen)
        left = seen - (near @ turn.T + shift)
        scatter = float(
            np.sqrt(np.mean(left**2) * len(near) / (len(near) - 2))
        )  # six of three a point were fitted
        place = turn @ np.array(near_mm) + shift
        return tuple(map(float, place)), min(self._within_mm, max(_LEAST_MM, _TIMES * scatter))


def carried(near: Points, seen: Points) -> tuple[Points, Points]:
    """Compute the rotation (3, 3) and shift (3,) that move (n, 3) points closest to others."""
    a, b = near.mean(axis=0), seen.mean(axis=0)
    u, _, v = np.linalg.svd((near - a).T @ (seen - b))
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(v.T @ u.T))])
    turn = v.T @ mirror @ u.T
    return turn, b - turn @ a
