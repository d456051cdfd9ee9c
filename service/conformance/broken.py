"""The end of a promise that does not hold."""

from __future__ import annotations

from collections.abc import Callable

from drivers import AcquisitionError


class Broken(AssertionError):
    """A promise that does not hold, and what was seen instead, in a sentence."""


def hold(condition: bool, otherwise: str) -> None:
    """Raise Broken with the sentence `otherwise` unless the condition is true."""
    if not condition:
        raise Broken(otherwise)


def refused(
    kinds: type[AcquisitionError] | tuple[type[AcquisitionError], ...], what: str, act: Callable[[], object]
) -> AcquisitionError:
    """The error in which `act` ends. Raises Broken where it ends without one, or in one that is none of `kinds`."""
    wanted = kinds if isinstance(kinds, tuple) else (kinds,)
    right = " or ".join(kind.__name__ for kind in wanted)
    try:
        act()
    except wanted as error:
        return error
    except AcquisitionError as error:
        raise Broken(f"{what} ended in {type(error).__name__} ({error.message}), {right} is right") from error
    raise Broken(f"{what} was not refused, {right} is right")
