"""An export as its formats see it, and what makes a format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from calib.arm import Robot
from calib.array import Array
from calib.compensate import Mounting, RepresentableModel
from calib.errors import DataError

_UNKNOWN = Mounting({}, (), turned=False, world=None)


@dataclass(frozen=True)
class ExportRequest:
    """An export: the robot, its joint counting, the content, lines about it, the hash.

    `simulated` says that the model was identified from simulators. A table of numbers has no place for lines and
    gets a column. `mounting` has the tool points and the base of the readings.
    """

    robot: Robot
    coupling: str
    carried: RepresentableModel
    about: tuple[str, ...]
    hash: str | None
    simulated: bool = False
    mounting: Mounting = _UNKNOWN


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes
    ----------
    holds : callable
        Returns the slots that the format can carry.
    writes : callable
        Returns the file's text.
    reads : callable
        Returns the poses (n, 4, 4) of the flange that a text gives at `carried.joints`, mm.
    says : str
        Content of the format, for people.
    suits : callable
        Raises DataError for a robot for which the format is not made.
    notes : callable
        Returns what people must know about the file, beyond its error.
    """

    holds: Callable[[Robot], tuple[str, ...]]
    writes: Callable[[ExportRequest], str]
    reads: Callable[[str, ExportRequest], Array]
    says: str
    suits: Callable[[Robot], None] = lambda robot: None
    notes: Callable[[ExportRequest], tuple[str, ...]] = lambda export: ()


def for_maker(begins: str, called: str) -> Callable[[Robot], None]:
    """Return a check that raises DataError unless a robot has six joints and is of the maker.

    The name of the maker in robot files `begins` so.
    """

    def suits(robot: Robot) -> None:
        theirs = robot.maker.casefold().startswith(begins.casefold())
        if not theirs or robot.joints != 6:
            raise DataError(
                f"the model is of {robot.name} by {robot.maker or 'an unnamed maker'}.",
                do=f"This format is for {called} robots{' of six joints' if theirs else ''}.",
                key="--format",
            )

    return suits
