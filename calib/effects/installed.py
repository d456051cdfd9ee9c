"""Effects of other packages: entry points of the group `truepose.effects`, each a module like those in this package."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from calib.errors import DataError

GROUP = "truepose.effects"


@cache
def installed() -> tuple[Any, ...]:
    """The modules, by name of their entry points. Raises DataError for one that cannot be used."""
    return tuple(_loaded(point) for point in sorted(entry_points(group=GROUP), key=lambda each: each.name))


def _loaded(point: EntryPoint) -> Any:
    package = point.dist.name if point.dist is not None else point.value
    place = f"effect '{point.name}' of the package {package}"
    try:
        entry = point.load()
    except (ImportError, AttributeError) as error:
        raise DataError(
            f"cannot be loaded: {error}.", do="Repair or remove the package.", file=place
        ) from error
    missing = [name for name in ("KINDS", "offer") if not hasattr(entry, name)]
    if missing:
        raise DataError(f"has no {missing[0]}.", do="See docs/extending.md.", file=place)
    return entry
