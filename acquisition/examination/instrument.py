"""The examination of the instrument: identity, readiness, weather, clock, battery, targets.

Nothing is armed, pointed or set. A tracker's reflector is set when it is armed and not before. A person must check
which SMR sits in which nest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from acquisition.cell.cell import Cell, match_instrument
from acquisition.examination.finding import Chart
from acquisition.examination.meeting import Place, compare_clocks, examine_device, read_clock
from calib.units import percent
from drivers.details import Details
from drivers.errors import Busy, ConfigError, EmergencyStop, NotReady
from drivers.interfaces import InstrumentStatus, LengthMeter, PointMeter

Instrument = PointMeter | LengthMeter
_USUAL: Mapping[str, tuple[str, str, float, float]] = {
    "t_air_c": ("air", "degC", 10.0, 40.0),
    "pressure_hpa": ("pressure", "hPa", 700.0, 1080.0),
    "humidity_percent": ("humidity", "%", 5.0, 95.0),
}
_BATTERY_LOW, _BATTERY_EMPTY = 20.0, 5.0


def examine_instrument(cell: Cell, instrument: Instrument, chart: Chart, place: Place) -> None:
    """Examine the instrument; the findings go into `chart`.

    It ends when the link breaks, and disconnects.
    """
    more = partial(_examine, cell, instrument, chart, place.time_scale)
    examine_device(instrument, chart, place, partial(match_instrument, cell), more)


def _examine(cell: Cell, instrument: Instrument, chart: Chart, time_scale: float) -> None:
    declared = cell.instrument.declared
    if declared.by_hand:
        return  # only a person can be asked
    clock = partial(declared.clock_s, instrument)
    first = read_clock(clock, chart)
    status = chart.ask("status", instrument.status)
    if status is not None:
        details = chart.ask("details", partial(declared.details, instrument, status)) or Details()
        _state(chart, status.state)
        if details.weather_station is False:  # values reported then are old
            status = replace(status, t_air_c=None, pressure_hpa=None, humidity_percent=None)
        _weather(chart, status, needed=declared.needs_weather)
        if details.battery_percent is not None:
            _battery(chart, details.battery_percent)
        if details.bar_mm is not None and declared.stroke_mm is not None:
            _bar(chart, details.bar_mm, cell.instrument.nominal_mm, declared.stroke_mm)
        if details.bodies:
            _bodies(cell, chart, details)
    unreported = [] if compare_clocks(clock, chart, first, time_scale) else ["clock"]
    unreported.extend(declared.unreported)
    if unreported:
        chart.ok("untold", f"this protocol does not report: {', '.join(unreported)}")


def _state(chart: Chart, state: str) -> None:
    if state == "READY":
        chart.ok("state", "ready")
    elif state == "OFF":
        chart.note(
            "state",
            "not initialised",
            "A campaign initialises it, which takes minutes and moves its head; or do it now in its own program.",
        )
    elif state == "ESTOP":
        chart.fault("state", EmergencyStop("instrument is in an emergency stop"))
    elif state == "BUSY":
        chart.fault("state", Busy("instrument is busy with something else"))
    elif state == "WARMING":
        chart.fault(
            "state",
            NotReady(
                "instrument is warming up", what_to_do="Wait until it is warm, as long as its manual states."
            ),
        )
    else:
        chart.fault(
            "state",
            NotReady(
                f"instrument is in state {state}",
                what_to_do="Open the maker's own program, clear the error there, and close that program again.",
            ),
        )


def _weather(chart: Chart, status: InstrumentStatus, *, needed: bool) -> None:
    values = {name: getattr(status, name) for name in _USUAL}
    shown = ", ".join(
        f"{what} {values[name]:.1f} {unit}"
        for name, (what, unit, *_) in _USUAL.items()
        if values[name] is not None
    )
    missing = [what for name, (what, *_) in _USUAL.items() if values[name] is None]
    odd = [
        what
        for name, (what, _, low, high) in _USUAL.items()
        if values[name] is not None and not low <= values[name] <= high
    ]
    if needed and missing:
        chart.fault(
            "weather",
            NotReady(
                f"the weather station does not report {', '.join(missing)}",
                what_to_do="Plug the weather station in and switch it on: 1 degC of air is 1 um/m of distance.",
            ),
        )
    elif odd:
        chart.note(
            "weather",
            f"{shown}: {' and '.join(odd)} is unusual",
            "Compare with another thermometer or barometer; check the unit of the weather station.",
        )
    elif shown:
        chart.ok("weather", shown)


def _battery(chart: Chart, charge: float) -> None:
    left = percent(charge / 100.0)
    if charge < _BATTERY_EMPTY:
        chart.fault("battery", NotReady(f"battery at {left}", what_to_do="Change the battery."))
    elif charge < _BATTERY_LOW:
        chart.note("battery", left, "Have a fresh battery at hand before a long campaign.")
    else:
        chart.ok("battery", left)


def _bar(chart: Chart, calibrated_mm: float, nominal_mm: float, stroke_mm: float) -> None:
    if abs(calibrated_mm - nominal_mm) > stroke_mm:
        chart.fault(
            "ballbar",
            NotReady(
                f"the bar is calibrated to {calibrated_mm:g} mm, the cell needs {nominal_mm:g} mm",
                what_to_do="Mount the extension bar that the cell file asks for, or correct nominal_mm there.",
            ),
        )
    else:
        chart.ok("ballbar", f"calibrated to {calibrated_mm:.4f} mm, the cell needs {nominal_mm:g} mm")


def _bodies(cell: Cell, chart: Chart, details: Details) -> None:
    """Check that a camera knows the bodies of the tool and of the nests by name."""
    unknown = [name for name in (*cell.tool.targets, *cell.nests) if name not in details.bodies]
    reference, needed = details.reference
    found = details.bodies.get(reference, 0)
    if unknown:
        chart.fault(
            "bodies",
            ConfigError(
                f"no body {', '.join(unknown)}; the instrument knows {', '.join(details.bodies)}",
                what_to_do="Teach these bodies in the instrument's program, or use its names in the cell file.",
            ),
        )
    elif found < needed:
        chart.fault(
            "bodies",
            NotReady(
                f"reference '{reference}' has {found} targets, needed {needed}",
                what_to_do="Stick more reflective targets on the base and teach the reference body again.",
            ),
        )
    else:
        chart.ok(
            "bodies", f"reference of {found} targets; all of the cell's {len(details.bodies) - 1} are known"
        )
