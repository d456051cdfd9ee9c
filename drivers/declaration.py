"""The declaration of a driver: what other packages have to know of it, so that none of them names it.

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
    """A number that the cell file has for one driver, mm unless its key says otherwise.

    needed: the file must have it; default: what the driver takes without it, None where that depends.
    """

    key: str
    needed: bool = False
    low: float = 1.0
    high: float = 5000.0
    default: float | None = None


@dataclass(frozen=True, slots=True)
class TextOption:
    """A text that the cell file may have for one driver, one of `allowed` where there are any."""

    key: str
    allowed: tuple[str, ...] = ()
    default: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotDriver:
    """A driver of robots: one protocol or dialect. `make` takes URL, speeds and limits of the cell, and a wire log.

    joints: how many it drives, all of which turn; a cell with another robot is refused before anything connects.
    takes_reach: `make` takes `reach_mm` as well, and keeps the speed of the path with it.
    details: what a connected robot says of itself beyond the status that it has just answered; raises LinkError.
    clock_s: the controller's own clock, None where the protocol does not say; raises LinkError.
    streams: its joints can be recorded while it moves (`drivers.interfaces.Streaming`).
    by_hand: a person drives it, at no address: what they say it shows is what was commanded.
    """

    name: str
    make: Callable[..., RobotArm]
    joints: int = 6
    options: tuple[Option | TextOption, ...] = ()
    by_hand: bool = False
    takes_reach: bool = False
    streams: bool = False
    details: Callable[[Any, RobotStatus], Details] = _nothing_more
    clock_s: Callable[[Any], float | None] = _no_clock


@dataclass(frozen=True, slots=True, kw_only=True)
class InstrumentDriver:
    """A driver of instruments of one maker. `make` takes the URL, `options` of the cell file, and a wire log.

    instrument: its name in data sets. cone_deg: the largest angle between a target's normal and the direction to the
    instrument. stroke_mm: of a ballbar, to either side; None for an instrument that measures points. finds_by_name:
    it finds a target by its name, before the world is known. needs_weather: its wavelength depends on the air.
    body_mm, extensions_mm: of a ballbar without extension bars, and of these.
    by_hand: a person reads it, at no address. takes_within: `make` takes `within_mm` as well, how far a point may be
    from where it should be. unreported: what its protocol does not say, and a person has to look at. details,
    clock_s, streams: as for a `RobotDriver`.
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
