"""The questions to all devices: whether each answers, who it is, and whether its clock is right.

Nothing is armed, moved or set; connecting only greets.

A device's clock is compared with the steady clock of this computer: does it run, and at which rate? The moment at
which the device read its clock lies between question and answer; half of that interval is the uncertainty. Two
readings half a second apart show a clock that is stopped, or that counts in other units than it states. They cannot
show a slow crystal. Times in s.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from acquisition.cell.cell import Match, OtherDevice
from acquisition.examination.finding import Chart
from drivers.errors import AcquisitionError, LinkError, ProtocolError, SafetyStop
from drivers.interfaces import Device, Identity, OperatedByPerson, weakness_of

_MOST_TIMES_MORE = 3  # connected after a question without an answer, each of which takes its deadline
APART_S = 0.5
_RATE_OFF = 0.05
_CALENDAR = (1.0e9, 4.0e9)  # seconds since 1970, from 2001 to 2096
_OFFSET_S = 2.0


@dataclass(frozen=True, slots=True)
class Place:
    """The address of a device, and the rate at which its clock should run.

    The rate is 1 except for simulators.
    """

    name: str
    simulated: bool = False
    time_scale: float = 1.0


def examine_device(
    device: Device, chart: Chart, place: Place, match: Callable[[Identity], Match], ask: Callable[[], None]
) -> None:
    """Connect to the device, ask the questions of its kind with `ask`, and disconnect.

    A question that breaks the link is left out, and the device is connected again for the others. The examination ends
    when the device does not answer.
    """
    left = _MOST_TIMES_MORE

    def again() -> bool:
        nonlocal left
        left -= 1
        if left < 0:
            return False
        with suppress(AcquisitionError):
            device.connect()
            return True
        return False

    chart.again = again
    try:
        if _meet(device, chart, place, match):
            ask()
    except LinkError:
        return  # it is in the chart, and nothing more can be asked
    finally:
        device.disconnect()


def _meet(device: Device, chart: Chart, place: Place, match: Callable[[Identity], Match]) -> bool:
    """Connect, compare the device with the cell file, and return whether more can be asked.

    Raises
    ------
    LinkError
        The link broke and the device cannot be queried further.
    """
    begun = time.monotonic()
    try:
        chart.begin("link")
        device.connect()
    except AcquisitionError as error:
        chart.fault("safety" if isinstance(error, SafetyStop) else "link", error)
        if isinstance(
            error.__cause__, ConnectionRefusedError
        ):  # a computer is there: another port may identify it
            with suppress(AcquisitionError):
                who = device.identify()
                _compare(chart, who, match(who))
        return False
    chart.ok("link", f"{place.name} answers, {time.monotonic() - begun:.2f} s")
    who = chart.ask("identity", device.identify)
    if who is not None:
        _compare(chart, who, match(who))
        if who.simulated and not place.simulated:
            chart.note("simulated", "a simulator answers, no device", "Correct the url in the cell file.")
    weakness = weakness_of(device)
    if weakness and isinstance(device, OperatedByPerson):
        chart.note("hand", weakness, "Have what is typed read once more before it is confirmed.")
    elif weakness:
        chart.note(
            "wire",
            weakness,
            "Use a program or bridge with checksums, and a cable of its own between it and this computer.",
        )
    if device.unverified_on_hardware:
        chart.note(
            "driver",
            "this driver has not been tried on hardware yet",
            "Compare its first readings with the pendant or the maker's own program.",
        )
    return True


def _compare(chart: Chart, who: Identity, match: Match) -> None:
    parts = (
        f"{who.maker} {who.model}".strip(),
        f"serial {who.serial}" if who.serial else "no serial number reported",
        f"software {who.firmware}" if who.firmware else "",
        who.protocol,
    )
    chart.ok("identity", ", ".join(part for part in parts if part))
    if match.agrees:
        chart.ok("model", match.text)
    elif match.agrees is None:
        chart.note("model", match.text, "Compare the type plate with the cell file.")
    else:
        chart.fault("model", OtherDevice(match.text))


def read_clock(clock_s: Callable[[], float | None], chart: Chart) -> ClockReading | None:
    """Read the device's clock, or return None if it does not report one.

    Raises
    ------
    LinkError
        The link broke and the device cannot be queried further.
    """
    asked, utc = time.monotonic(), time.time()
    device_s = chart.ask("clock", clock_s)
    return None if device_s is None else ClockReading(device_s, asked, time.monotonic(), utc)


def compare_clocks(
    clock_s: Callable[[], float | None], chart: Chart, first: ClockReading | None, time_scale: float
) -> bool:
    """Read the clock again, APART_S after the first reading, and return whether both exist.

    Raises
    ------
    LinkError
        The link broke and the device cannot be queried further.
    """
    if first is None:
        return False
    time.sleep(max(0.0, first.answered_s + APART_S - time.monotonic()))
    second = read_clock(clock_s, chart)
    if second is not None:
        examine_clock(chart, first, second, time_scale)
    return True


@dataclass(frozen=True, slots=True)
class ClockReading:
    """A reading of a device's clock.

    `device_s` was read between `asked_s` and `answered_s`, both of `time.monotonic`; `utc_s` is the calendar time then.
    """

    device_s: float
    asked_s: float
    answered_s: float
    utc_s: float

    @property
    def at_s(self) -> float:
        """Time midway between question and answer, s."""
        return 0.5 * (self.asked_s + self.answered_s)


def rate_of(first: ClockReading, second: ClockReading) -> tuple[float, float]:
    """Compute the rate of the device's clock, device seconds per second, and its uncertainty."""
    apart = second.at_s - first.at_s
    spread = 0.5 * (first.answered_s - first.asked_s + second.answered_s - second.asked_s)
    rate = (second.device_s - first.device_s) / apart
    return rate, abs(rate) * spread / apart


def examine_clock(chart: Chart, first: ClockReading, second: ClockReading, time_scale: float) -> None:
    """Compare a clock with the calendar.

    `time_scale` is the rate at which it should run, 1 except for simulators.
    """
    rate, spread = rate_of(first, second)
    shown = f"{rate:.3f} +- {spread:.3f} s a second"
    if second.device_s <= first.device_s:
        chart.fault(
            "clock",
            ProtocolError(
                f"the device's clock is stopped at {second.device_s:.3f} s",
                what_to_do="Restart the device or its bridge: readings without a running clock are refused.",
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
