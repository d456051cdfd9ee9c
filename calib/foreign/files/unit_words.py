"""Words for units, as headers have them: `[mm]`, `(deg)`, `in °`, `Grad`, `_rad`."""

from __future__ import annotations

import re
from collections.abc import Sequence

_WORDS = {
    "mm": ("mm", "millimeter", "millimeters", "millimetre", "millimetres"),
    "m": ("m", "meter", "meters", "metre", "metres"),
    "um": ("um", "µm", "μm", "micron", "microns", "micrometer", "mikrometer"),
    "cm": ("cm", "centimeter", "zentimeter"),
    "in": ("in", "inch", "inches", "zoll", '"'),
    "deg": ("deg", "degs", "degree", "degrees", "°", "grad", "º"),
    "rad": ("rad", "radian", "radians", "bogenmaß", "bogenmass"),
    "mrad": ("mrad",),
    "gon": ("gon",),
    "s": ("s", "sec", "secs", "second", "seconds", "sekunde", "sekunden"),
    "ms": ("ms", "msec", "millisecond", "milliseconds"),
    "us": ("us", "µs", "μs"),
    "min": ("min", "minutes"),
    "c": ("c", "°c", "degc", "celsius"),
    "?": ("ft", "feet", "km", "µrad", "arcsec", "inc", "incs", "counts", "%", "k", "°f"),
}
_UNIT = {word: unit for unit, words in _WORDS.items() for word in words}
_NO_UNIT = ("", "-", "--", "1", "text", "[-]", "(-)", "string", "n/a")
LONGEST = 200
"""Characters of a name that is looked at: what is longer names nothing."""
_BRACKETS = re.compile(r"[\[({<]\s*([^\])}>]{1,15}?)\s*[\])}>]")
_BEHIND = re.compile(r"(?:\s+in\s+|[_/,\s]\s*)([A-Za-zµμ°º\"]{1,12})$")


def unit_of(text: str) -> str:
    """Return the unit of a word, for example mm for `[mm]`.

    The result is `?` for a unit that is not supported, and '' for other words.
    """
    bare = text.strip().strip("[](){}<>").strip().lower()
    return _UNIT.get(bare, "")


def split(name: str) -> tuple[str, str]:
    """Split the name of a column from its unit: `X Pos. [mm]` -> `X Pos.`, mm."""
    if len(name) > LONGEST:
        return name, ""
    for match in _BRACKETS.finditer(name):
        if unit := unit_of(match[1]):
            return (name[: match.start()] + " " + name[match.end() :]).strip(), unit
    if (match := _BEHIND.search(name)) and (unit := _UNIT.get(match[1].lower(), "")) and match.start() > 0:
        single = len(match[1]) == 1 and match[1].isalpha()
        # a letter alone is a unit behind `_` or `/`, else a name: `Euler C`, `t_s`
        behind = name[match.start()] in "_/" and (unit != "c" or name.lower().startswith("t"))
        if not single or behind:
            return name[: match.start()].strip(), unit
    return name, ""


def unit_row(cells: Sequence[str]) -> bool:
    """Test whether a row holds only units."""
    found = [cell for cell in cells if cell.strip().lower() not in _NO_UNIT]
    return len(found) >= 2 and all(unit_of(cell) for cell in found)
