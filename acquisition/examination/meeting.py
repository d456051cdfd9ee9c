"""The questions to every device alike: does it answer, who is it, and what does its clock say?

Nothing is armed, moved or set; connecting greets, and nothing more.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from acquisition.cell.identity import Match, OtherDevice
from acquisition.examination.clocks import APART_S, ClockReading, examine_clock
from acquisition.examination.finding import Chart
from drivers.errors import AcquisitionError, LinkError, SafetyStop
from drivers.interfaces import Attended, Device, Identity, weakness_of

_MOST_TIMES_MORE = 3  # connected after a question without an answer, each of which takes its deadline


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a device: where it is looked for, and how fast its clock should run: 1, but for simulators."""

    name: str
    simulated: bool = False
    time_scale: float = 1.0


def examine_device(
    device: Device, chart: Chart, place: Place, match: Callable[[Identity], Match], ask: Callable[[], None]
) -> None:
    """Meet the device, `ask` it what only its kind can be asked, disconnect.

    A question that breaks the link is left out, and the device met again for the others; ends when it does not answer.
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
    """Connect and compare with the cell file; whether there is more to ask. Raises LinkError."""
    begun = time.monotonic()
    try:
        chart.begin("link")
        device.connect()
    except AcquisitionError as error:
        chart.fault("safety" if isinstance(error, SafetyStop) else "link", error)
        if isinstance(
            error.__cause__, ConnectionRefusedError
        ):  # a computer is there: another port may tell whose
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
    if weakness and isinstance(device, Attended):
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
    """A reading of the device's clock; None where it does not report one. Raises LinkError."""
    asked, utc = time.monotonic(), time.time()
    device_s = chart.ask("clock", clock_s)
    return None if device_s is None else ClockReading(device_s, asked, time.monotonic(), utc)


def compare_clocks(
    clock_s: Callable[[], float | None], chart: Chart, first: ClockReading | None, time_scale: float
) -> bool:
    """A second reading, APART_S after the first; whether there was one to compare. Raises LinkError."""
    if first is None:
        return False
    time.sleep(max(0.0, first.answered_s + APART_S - time.monotonic()))
    second = read_clock(clock_s, chart)
    if second is not None:
        examine_clock(chart, first, second, time_scale)
    return True
