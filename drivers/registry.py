"""The table of all drivers, one line per maker.

A new driver needs its folder and a line here. Other packages bring theirs with entry points of the group
`truepose.drivers`: modules with `DRIVERS`, like a maker's `declaration.py`. They are loaded when a requested name is
not in the tables.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

from drivers.abb import declaration as abb
from drivers.creaform import declaration as creaform
from drivers.declaration import InstrumentDriver, RobotDriver
from drivers.errors import ConfigError
from drivers.fanuc import declaration as fanuc
from drivers.faro import declaration as faro
from drivers.interfaces import LengthMeter, PointMeter, RobotArm
from drivers.leica import declaration as leica
from drivers.manual import declaration as manual
from drivers.renishaw import declaration as renishaw
from drivers.ur import declaration as ur
from drivers.yaskawa import declaration as yaskawa

GROUP = "truepose.drivers"

_D = TypeVar("_D", RobotDriver, InstrumentDriver)

_T = TypeVar("_T")


def _by_name(makers: Iterable[Iterable[_D]]) -> dict[str, _D]:
    return {driver.name: driver for drivers in makers for driver in drivers}


ROBOTS: Mapping[str, RobotDriver] = _by_name(
    [abb.DRIVERS, fanuc.DRIVERS, ur.DRIVERS, yaskawa.DRIVERS, manual.ROBOTS]
)

INSTRUMENTS: Mapping[str, InstrumentDriver] = _by_name(
    [creaform.DRIVERS, faro.DRIVERS, leica.DRIVERS, renishaw.DRIVERS, manual.INSTRUMENTS]
)


def robot_driver(name: str) -> RobotDriver:
    """Return the declaration of a robot driver by its name.

    Raises
    ------
    ConfigError
        The name is unknown.
    """
    return _known("robot", ROBOTS, RobotDriver, name)


def instrument_driver(name: str) -> InstrumentDriver:
    """Return the declaration of an instrument driver by its name.

    Raises
    ------
    ConfigError
        The name is unknown.
    """
    return _known("instrument", INSTRUMENTS, InstrumentDriver, name)


def open_robot(driver: str, url: str, **options: Any) -> RobotArm:
    """Create the driver of a robot by its name, not yet connected.

    Raises
    ------
    ConfigError
        The name is unknown, or an option is not valid.
    """
    return _make("robot", driver, robot_driver(driver).make, url, options)


def open_instrument(driver: str, url: str, **options: Any) -> PointMeter | LengthMeter:
    """Create the driver of an instrument by its name, not yet connected.

    Raises
    ------
    ConfigError
        The name is unknown, or an option is not valid.
    """
    return _make("instrument", driver, instrument_driver(driver).make, url, options)


def _known(kind: str, table: Mapping[str, _D], of: type[_D], name: str) -> _D:
    if name in table:
        return table[name]
    more = {driver.name: driver for driver in _installed() if isinstance(driver, of)}
    if name in more:
        return more[name]
    raise ConfigError(f"{kind} driver {name!r} unknown; there are {', '.join(sorted({*table, *more}))}")


@cache
def _installed() -> tuple[RobotDriver | InstrumentDriver, ...]:
    """Return the drivers of other packages.

    Raises
    ------
    ConfigError
        A package cannot be used.
    """
    return tuple(installed(GROUP, "DRIVERS"))


def _make(kind: str, name: str, make: Callable[..., _T], url: str, options: Mapping[str, Any]) -> _T:
    try:
        return make(url, **options)
    except TypeError as error:
        raise ConfigError(
            f"{kind} driver {name!r}: {error}",
            what_to_do="Correct the options of the driver in the cell file.",
        ) from error


def installed(group: str, name: str) -> Iterator[Any]:
    """Yield the members of the lists named `name` in the modules of a group of entry points.

    Such a name is `DRIVERS`, for example.

    Raises
    ------
    ConfigError
        A package cannot be loaded.
    """
    for point in entry_points(group=group):
        yield from _list_in(point, name)


def _list_in(point: EntryPoint, name: str) -> Any:
    package = point.dist.name if point.dist is not None else point.value
    try:
        return getattr(point.load(), name)
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"{name.lower()} '{point.name}' of the package {package} cannot be loaded: {error}",
            what_to_do="Repair or remove the package.",
        ) from error
