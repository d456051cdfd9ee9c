"""The declaration of a driver, so that no other package needs to name a driver.

Each maker's folder has one file `declaration.py` with the declarations of its drivers; `drivers.registry` lists them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.details import Details
from drivers.interfaces import InstrumentStatus, LengthMeter, PointMeter, RobotArm, RobotStatus

SMR_CONE_DEG = 30.0
"""A corner cube in its ball (SMR) returns the beam up to this angle from its normal."""


def _nothing_more(device: Any, status: RobotStatus | InstrumentStatus) -> Details:
    return Details()


def _no_clock(device: Any) -> float | None:
    return None


@dataclass(frozen=True, slots=True)
class Option:
    """A number in the cell file for one driver, mm unless its key states otherwise.

    Attributes
    ----------
    needed
        Whether the file must have it.
    default
        Value that the driver uses without it; None if that depends.
    words
        Its meaning, with the unit.
    """

    key: str
    needed: bool = False
    low: float = 1.0
    high: float = 5000.0
    default: float | None = None
    words: str = ""


@dataclass(frozen=True, slots=True)
class TextOption:
    """A text in the cell file for one driver, one of `allowed` if there are any."""

    key: str
    allowed: tuple[str, ...] = ()
    default: str = ""
    words: str = ""


@dataclass(frozen=True, slots=True)
class NumbersOption:
    """Required positive numbers in the cell file for one driver of robots, one per joint."""

    key: str
    words: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotDriver:
    """A driver of robots: one protocol or dialect.

    Attributes
    ----------
    make
        Creates the driver from URL, speeds and limits of the cell, and a wire log.
    joints
        Number of joints that it drives, all of which turn; a cell with another robot is refused before anything
        connects.
    scheme
        Beginning of its addresses: `tcp`, or `udp` for a protocol of datagrams.
    takes_reach
        Whether `make` takes `reach_mm` as well, to keep the speed of the path.
    details
        Returns details of a connected robot in addition to the given status; may raise LinkError.
    clock_s
        Returns the controller's own clock, None if the protocol does not report it; may raise LinkError.
    streams
        Whether its joints can be recorded while it moves (`drivers.interfaces.Streaming`).
    by_hand
        Whether a person drives it, without an address: the joints that they report count as commanded.
    """

    name: str
    make: Callable[..., RobotArm]
    joints: int = 6
    scheme: str = "tcp"
    options: tuple[Option | TextOption | NumbersOption, ...] = ()
    by_hand: bool = False
    takes_reach: bool = False
    streams: bool = False
    details: Callable[[Any, RobotStatus], Details] = _nothing_more
    clock_s: Callable[[Any], float | None] = _no_clock


@dataclass(frozen=True, slots=True, kw_only=True)
class InstrumentDriver:
    """A driver of instruments of one maker.

    Attributes
    ----------
    instrument
        Its name in data sets.
    make
        Creates the driver from the URL, `options` of the cell file, and a wire log.
    by_hand
        Whether a person reads it, without an address.
    takes_within
        Whether `make` takes `within_mm` as well, the largest distance of a point from its expected place.
    cone_deg
        Largest angle between a target's normal and the direction to the instrument.
    stroke_mm
        Stroke of a ballbar, to either side; None for an instrument that measures points.
    body_mm, extensions_mm
        Length of a ballbar without extension bars, and lengths of these.
    finds_by_name
        Whether it finds a target by its name, before the world is known.
    needs_weather
        Whether its wavelength depends on the air.
    unreported
        Facts that its protocol does not report and that a person must check.
    details, clock_s, streams
        As for a `RobotDriver`.
    """

    name: str
    maker: str
    instrument: str
    make: Callable[..., PointMeter | LengthMeter]
    options: tuple[Option | TextOption, ...] = ()
    by_hand: bool = False
    takes_within: bool = False
    cone_deg: float = SMR_CONE_DEG
    stroke_mm: float | None = None
    body_mm: float = 0.0
    extensions_mm: tuple[float, ...] = ()
    finds_by_name: bool = True
    needs_weather: bool = False
    streams: bool = False
    unreported: tuple[str, ...] = ()
    details: Callable[[Any, InstrumentStatus], Details] = _nothing_more
    clock_s: Callable[[Any], float | None] = _no_clock

    @property
    def measures_lengths(self) -> bool:
        """Whether it is a ballbar, which measures distances to balls on the base instead of points."""
        return self.stroke_mm is not None
