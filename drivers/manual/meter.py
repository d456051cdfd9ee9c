"""An instrument that a person reads: x, y, z in its own frame are typed or pasted.

Several rows at once are readings of one point: their mean counts, and their scatter is kept. A point far from its
expected place (`drivers.manual.prediction`) is requested again, with the slip of the hand that would explain it. If it
is typed in the same way again, or confirmed, it is accepted.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from statistics import fmean, stdev

from drivers.errors import ConfigError, NotArmed
from drivers.interfaces import Asking, Identity, InstrumentStatus, PointReading, TypedEntry
from drivers.link import WireSink
from drivers.manual.asking import Questions, TypingDoubt, in_words
from drivers.manual.prediction import Prediction
from drivers.manual.slips import slip_of
from drivers.manual.typed import MM_OF, InvalidEntry, TypedRow

_AXES = ("x", "y", "z")
_ONE_POINT_MM = 1.0  # rows of one point lie closer together


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
            raise ConfigError(f"unit {unit!r} is none of {', '.join(MM_OF)}", device=name)
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
