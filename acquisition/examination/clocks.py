"""A device's clock against the steady clock of this computer: does it run, and at which rate?

The moment at which the device looked at its clock lies somewhere between question and answer; half of that time is
the uncertainty. Two readings half a second apart show a clock that is stopped, or that counts in other units than it
says; they cannot show a slow crystal. Seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

from acquisition.examination.finding import Chart
from drivers.errors import ProtocolError

APART_S = 0.5
_RATE_OFF = 0.05
_CALENDAR = (1.0e9, 4.0e9)  # seconds since 1970, from 2001 to 2096
_OFFSET_S = 2.0


@dataclass(frozen=True, slots=True)
class ClockReading:
    """`device_s` was read between `asked_s` and `answered_s`, both of `time.monotonic`; `utc_s`: the calendar then."""

    device_s: float
    asked_s: float
    answered_s: float
    utc_s: float

    @property
    def at_s(self) -> float:
        """Midway between question and answer."""
        return 0.5 * (self.asked_s + self.answered_s)


def rate_of(first: ClockReading, second: ClockReading) -> tuple[float, float]:
    """Device seconds a second, and how far that may be off."""
    apart = second.at_s - first.at_s
    spread = 0.5 * (first.answered_s - first.asked_s + second.answered_s - second.asked_s)
    rate = (second.device_s - first.device_s) / apart
    return rate, abs(rate) * spread / apart


def examine_clock(chart: Chart, first: ClockReading, second: ClockReading, time_scale: float) -> None:
    """Hold a clock against the calendar. time_scale: the rate at which it should run, 1 but for simulators."""
    rate, spread = rate_of(first, second)
    shown = f"{rate:.3f} +- {spread:.3f} s a second"
    if second.device_s <= first.device_s:
        chart.fault(
            "clock",
            ProtocolError(
                f"the device's clock is stopped at {second.device_s:.3f} s",
                what_to_do="Start the device or its bridge anew: readings without a running clock are refused.",
            ),
        )
    elif abs(rate - time_scale) > max(_RATE_OFF * time_scale, 3.0 * spread):
        chart.note(
            "clock",
            f"runs at {shown}",
            "Compare the unit of the device's time with its manual: the times of its readings are off.",
        )
    elif _CALENDAR[0] < second.device_s < _CALENDAR[1] and abs(second.device_s - second.utc_s) > _OFFSET_S:
        chart.note(
            "clock",
            f"{second.device_s - second.utc_s:+.1f} s from this computer's, runs at {shown}",
            "Set both clocks by the same time server, else their logs cannot be laid side by side.",
        )
    else:
        chart.ok("clock", f"{second.device_s:.1f} s, runs at {shown}")
