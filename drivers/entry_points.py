"""Additions from other packages: lists in modules that they name as entry points."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from drivers.errors import ConfigError


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
