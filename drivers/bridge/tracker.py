"""The common part of trackers behind an MBP/1 bridge: weather, pointing, checks of points.

A reading is refused if:

- it has another number of samples than requested, or a status other than accurate
- it is too old, or the device clock did not advance (for steps of the clock see `drivers.bridge.session`)
- it is scattered, or at the origin (the result of a failed vendor call)
- polar and Cartesian coordinates disagree
- the beam was lost within the averaging time
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from drivers.bridge import mbp
from drivers.bridge.session import MbpSession
from drivers.errors import (
    AcquisitionError,
    BeamBroken,
    ConfigError,
    NoisyMeasurement,
    NotReady,
    ProtocolError,
    TargetNotSeen,
)
from drivers.interfaces import InstrumentStatus, PointReading

FARTHEST_MM = 100_000.0  # beyond the range of any tracker
_POLAR_AGREES_MM = 0.05
_VOID: Mapping[str, type[AcquisitionError]] = {"BEAM_BROKEN": BeamBroken, "TARGET_LOST": TargetNotSeen}


@dataclass(frozen=True, slots=True)
class MeasureRequest:
    """A requested measurement; `lasted_s` is the averaging time."""

    target: str
    samples: int
    lasted_s: float
    age_limit_s: float
    scatter_limit_mm: float


def check_question(target: str, samples: int, device: str) -> None:
    """Check a question before it is sent.

    Raises
    ------
    ConfigError
        The target name is not a word, or there is less than one sample.
    """
    if not (target.isidentifier() and target.isascii()):
        raise ConfigError(
            f"target name {target!r} is not a word",
            device=device,
            command="measure",
            what_to_do="Use letters, digits and underscores.",
        )
    if samples < 1:
        raise ConfigError(
            f"samples = {samples} must be at least 1",
            device=device,
            command="measure",
            what_to_do="Set samples to 1 or more.",
        )


def ask_weather(session: MbpSession, fields: Mapping[str, object]) -> tuple[float, float, float]:
    """Return air temperature (degC), pressure (hPa) and humidity (%) as known to the tracker.

    Raises
    ------
    NotReady
        The tracker has no weather station.
    ProtocolError
        A value is missing or not plausible.
    """
    reply = session.ask("WEATHER", fields)
    with session.understood():
        return (
            mbp.number(reply, "T", -20.0, 60.0),
            mbp.number(reply, "P", 500.0, 1200.0),
            mbp.number(reply, "H", 0.0, 100.0),
        )


def status_of(session: MbpSession) -> InstrumentStatus:
    """Return state and weather, from STATUS or, if it has no weather, from WEATHER.

    Raises
    ------
    LinkError
        The connection failed.
    SafetyStop
        The bridge reports one.
    """
    status = session.status()
    if None not in (status.t_air_c, status.pressure_hpa, status.humidity_percent):
        return status
    try:
        t_air_c, pressure_hpa, humidity_percent = ask_weather(session, {})
    except NotReady:  # no station, or not yet
        return status
    return replace(status, t_air_c=t_air_c, pressure_hpa=pressure_hpa, humidity_percent=humidity_percent)


def point_at(session: MbpSession, near_mm: Sequence[float], seconds: float, **fields: object) -> None:
    """Point the beam at a place (tracker's frame) and find the nearest SMR.

    Raises
    ------
    ConfigError
        The place is not finite, or too far away.
    """
    x, y, z = (float(value) for value in near_mm)
    if not all(math.isfinite(value) and abs(value) < FARTHEST_MM for value in (x, y, z)):
        raise ConfigError(
            f"cannot point at {near_mm}", command="POINT", what_to_do="Give three finite coordinates in mm."
        )
    session.ask("POINT", {"x": x, "y": y, "z": z, "find": 1, **fields}, "point_s", seconds)


def point_of(session: MbpSession, reply: mbp.Message, asked: MeasureRequest) -> PointReading:
    """Return the reading of an answer, in the tracker's own frame.

    Raises
    ------
    ProtocolError
        The answer is impossible.
    BeamBroken, TargetNotSeen, NoisyMeasurement
        The reading cannot be used.
    """

    def value(key: str, low: float = -FARTHEST_MM, high: float = FARTHEST_MM) -> float:
        return mbp.number(reply, key, low, high)

    x, y, z = value("x"), value("y"), value("z")
    std = (value("sx", 0.0), value("sy", 0.0), value("sz", 0.0))
    t_s, age_s = value("t", -1e12, 1e12), value("age", -1e12, 1e12)
    advanced, far = session.advanced(t_s), math.hypot(x, y, z)
    for impossible, why in (
        (
            reply.fields.get("target", asked.target) != asked.target,
            f"reading of {reply.fields.get('target')}",
        ),
        (far < 1.0, "point at the origin of the tracker"),
        (
            "r" in reply.fields and abs(value("r", 0.0) - far) > _POLAR_AGREES_MM,
            "polar and Cartesian disagree",
        ),
    ):
        if impossible:
            raise ProtocolError(f"{why}, requested was {asked.target}", command="MEASURE", raw=reply.raw)
    session.void_if_reported(_VOID, t_s - asked.lasted_s, reply.raw)
    for bad, why in (
        (value("n", 0, 1e9) != asked.samples, f"not of {asked.samples} samples"),
        (value("status", 0, 9) != 0, "marked inaccurate"),
        (not 0.0 <= age_s <= asked.age_limit_s, f"{age_s:g} s old"),
        (not advanced, "from a device clock that did not advance"),
        (max(std) > asked.scatter_limit_mm, f"scattered by {max(std):g} mm"),
    ):
        if bad:
            raise NoisyMeasurement(f"reading {why}", raw=reply.raw)
    return PointReading(
        target=asked.target,
        xyz_mm=(x, y, z),
        std_mm=std,
        samples=asked.samples,
        t_s=t_s,
        age_s=age_s,
        t_air_c=value("temp", -40.0, 80.0) if "temp" in reply.fields else None,
        pressure_hpa=value("P", 300.0, 1300.0) if "P" in reply.fields else None,
        humidity_percent=value("H", 0.0, 100.0) if "H" in reply.fields else None,
        mode=reply.fields.get("mode", ""),
        face=reply.fields.get("face", ""),
        raw=reply.raw,
    )
