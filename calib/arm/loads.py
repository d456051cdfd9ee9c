"""Masses that load the joints, from the `[[loads]]` of a robot file or a data set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.errors import DataError
from calib.text.flags import refuse_flags

FARTHEST_MM = 1e5
HEAVIEST_KG = 1e5
"""No link is longer or heavier: what is was given in another unit."""


@dataclass(frozen=True)
class Load:
    """A mass on link `link` (1-based), kg, with its centre of gravity in that link's frame, mm."""

    link: int
    mass_kg: float
    cog_mm: tuple[float, float, float]


def parse_loads(entries: Any, joints: int, path: Path | str) -> tuple[Load, ...]:
    """Parse the `[[loads]]` of a robot file or a data set.

    Raises
    ------
    DataError
        A load is incomplete or not physical.
    """
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise DataError(
            "is not a list of tables.", do="Write every load as [[loads]].", file=path, key="loads"
        )
    refuse_flags(entries, path, "loads")
    return tuple(_load(entry, joints, path) for entry in entries)


def _load(entry: Mapping[str, Any], joints: int, path: Path | str) -> Load:
    try:
        link = entry["link"]
        mass, cog = float(entry["mass_kg"]), tuple(float(x) for x in entry["cog_mm"])
    except KeyError as error:
        raise DataError(
            "a load lacks this key.", do="Give link, mass_kg, cog_mm.", file=path, key=error.args[0]
        ) from error
    except (TypeError, ValueError) as error:
        raise DataError(
            f"a load is not made of numbers ({error}).",
            do="Give link (a joint's number), mass_kg and cog_mm = [x, y, z].",
            file=path,
            key="loads",
        ) from error
    if type(link) is not int or not 1 <= link <= joints or len(cog) != 3:
        raise DataError(
            f"a load names link {link} with {len(cog)} coordinates.",
            do=f"Use a link from 1 to {joints} and three coordinates in mm.",
            file=path,
            key="loads",
        )
    if not (0.0 < mass <= HEAVIEST_KG and all(abs(x) <= FARTHEST_MM for x in cog)):
        raise DataError(
            f"a load of {mass} kg is not possible.",
            do=f"Give its mass in kg, above zero, and its centre within {FARTHEST_MM:g} mm.",
            file=path,
            key="loads",
        )
    return Load(link, mass, (cog[0], cog[1], cog[2]))
