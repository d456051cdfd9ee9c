"""Words with which DH tables name their columns, and the numbers in their cells.

Cells hold terms such as `90`, `-pi/2`, `q2 + 90`, `12,5`, and ranges such as `-165..165` or `±165`.
Angles of a few digits in rad stand for multiples of 45 deg.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

ANGLES = ("alpha", "theta")
LENGTHS = ("a", "d")
LIMITS = ("min", "max")
_WORDS = {
    "alpha": ("alpha", "α", "twist", "linktwist", "al"),
    "a": ("a", "r", "linklength"),
    "theta": ("theta", "θ", "thetaoffset", "offset", "jointangle", "jointoffset", "th", "q", "teta"),
    "d": ("d", "linkoffset", "s"),
    "min": ("min", "lower", "low", "qmin", "minimum", "from", "lowerlimit", "minlimit", "limitmin"),
    "max": ("max", "upper", "high", "qmax", "maximum", "to", "upperlimit", "maxlimit", "limitmax"),
    "range": (
        *("range", "ranges", "limits", "limit", "jointrange", "jointlimits", "jointlimit", "motionrange"),
        *("workingrange", "rangeofmotion", "qlim", "qrange"),
    ),
    "beta": ("beta", "β"),
    "sign": (
        "sign",
        "direction",
        "dir",
        "sense",
        "sgn",
        "rotationdirection",
        "directionofrotation",
        "jointdirection",
    ),
    "kind": ("kind", "type", "jointtype", "sigma"),
    "link": ("link", "joint", "i", "n", "no", "nr", "axis", "frame", "k", "j", "name", "linkno", "jointno"),
}
_UNITS = {
    "deg": ("deg", "degree", "degrees", "°", "grad"),
    "rad": ("rad", "radian", "radians"),
    "mm": ("mm", "millimetre", "millimetres", "millimeter", "millimeters"),
    "m": ("m", "metre", "metres", "meter", "meters"),
}
_LONGEST = 60
"""No heading or number has more letters."""
_UNIT = re.compile(r"[\s_(\[/,]+([a-zµ°]+)[\])]?\s*$")
_INDEX = re.compile(r"_?[{(\[]?(?:i|k|j|n)(\s*-\s*1)?[})\]]?$")
_BETWEEN = (r"\.{2,}|…", r"\bto\b|\bbis\b", r"~", r";", r":", r"/", r"\s-\s", r",", r"\s+")
_EIGHTH = math.pi / 4.0
_MOST_DIGITS = 15
_JOINT = re.compile(r"(?<![a-zθ])(?:q|θ|theta|th|d|s)_?\d+\*?(?!\d)|\bq\b|\bvar(?:iable)?\b|^\*$")
_NUMBER = r"\d+(?:[.,]\d*)?(?:e[+-]?\d+)?|[.,]\d+(?:e[+-]?\d+)?"
_TERM = re.compile(
    rf"([+-]?)\s*(?:({_NUMBER})\s*°?\s*\*?\s*)?(pi|π)?\s*(?:/\s*({_NUMBER}))?\s*(?:deg|rad|mm|m|°)?"
)


@dataclass(frozen=True)
class Heading:
    """Heading of a column.

    Attributes
    ----------
    meaning : str or None
        Quantity of the column; None if it is not read.
    unit : str
        Unit in the name, "" without one.
    before : bool
        Whether the quantity is that of the link before: `alpha_{i-1}`.
    """

    meaning: str | None
    unit: str
    before: bool = False


@dataclass(frozen=True)
class DhCell:
    """Number in a cell.

    Attributes
    ----------
    pi : bool
        Whether it is a multiple of pi.
    variable : bool
        Whether the cell contains the joint's own variable.
    number : str
        Plain number without the sign, if the cell has just one.
    """

    value: float
    pi: bool = False
    variable: bool = False
    number: str = ""

    def meant(self, unit: str, rounded: dict[str, float]) -> float:
        """Return the exact angle for this number, in its unit, deg or rad.

        A rounded angle is added to `rounded`, with its value in deg.
        """
        if not self.number:
            return self.value
        read = exact_turn if unit == "rad" else _exact_deg
        return math.copysign(read(self.number, float(self.number), rounded), self.value)


def heading(text: str) -> Heading:
    """Parse a column's name: `alpha_{i-1} [deg]` is alpha in degrees."""
    if len(text) > _LONGEST:
        return Heading(None, "")
    word, unit = text.strip().lower().replace("−", "-"), ""
    if found := _UNIT.search(word):
        unit = next((unit for unit, words in _UNITS.items() if found[1] in words), "")
        word = word[: found.start()] if unit else word
    word = word.strip().strip("()[]")
    index = _INDEX.search(word)
    for shape in (word, _INDEX.sub("", word)):
        plain = re.sub(r"[\s_\-{}.()]+", "", shape)
        for meaning, words in _WORDS.items():
            if plain in words:
                return Heading(meaning, unit, shape != word and index is not None and bool(index[1]))
    return Heading(None, unit)


def cell(text: str) -> DhCell | None:
    """Parse the number in a cell; return None if there is none. Empty cells and dashes are 0."""
    if len(text) > _LONGEST:
        return None
    word = text.strip().lower().replace("−", "-").replace("–", "-")
    if word in ("", "-"):
        return DhCell(0.0)
    rest, variables = _JOINT.subn("", word)
    numbers = re.fullmatch(rf"\s*[+-]?\s*({_NUMBER})\s*(?:deg|rad|°)?\s*", rest)
    if variables > 1 or re.search(r"-\s*$|-\s*[qθ]", word):
        return None  # a joint that counts the other way needs more than a number
    rest = rest.strip().removeprefix("+").strip()
    if not rest:
        return DhCell(0.0, variable=True)
    terms = list(_terms(rest))
    if not terms or None in terms:
        return None
    found = [term for term in terms if term is not None]
    value = sum(value for value, _ in found)
    plain = "" if numbers is None else numbers[1].replace(",", ".")
    return DhCell(value, any(pi for _, pi in found), variables > 0, plain) if math.isfinite(value) else None


def ends(text: str) -> tuple[DhCell, DhCell] | None:
    """Parse both ends of a range, the lower first; return None for other texts.

    Examples are `-165..165`, `±165`, `+170/-170` and `[-2.88, 2.88]`.
    """
    if len(text) > _LONGEST:
        return None
    word = text.strip().lower().replace("−", "-").replace("–", "-").strip("[]() ")
    if found := re.match(r"(?:±|\+/-|\+-)\s*(.+)$", word):
        end = cell(found[1])
        return None if end is None else (DhCell(-abs(end.value), end.pi), DhCell(abs(end.value), end.pi))
    for between in _BETWEEN:
        parts = [part for part in re.split(between, word) if part.strip()]
        cells = [end for part in parts if (end := cell(part)) is not None]
        if len(parts) == len(cells) == 2 and not (between == "/" and re.search("pi|π", word)):
            low, high = sorted(cells, key=lambda end: end.value)
            return low, high
    return None


def exact_turn(word: str, angle: float, rounded: dict[str, float]) -> float:
    """Return the multiple of 45 deg, rad, of which `word` has the first digits.

    Other angles are returned unchanged. A rounded angle is added to `rounded`, with its value in deg.
    """
    multiple = round(angle / _EIGHTH)
    meant = multiple * _EIGHTH
    digits = min(len(word.lower().partition("e")[0].partition(".")[2]), _MOST_DIGITS)
    if multiple == 0 or digits < 2 or min(abs(angle - each) for each in _cut(meant, digits)) > 1e-14:
        return angle
    if abs(angle - meant) > 1e-9:
        rounded[f"{word} rad"] = multiple * 45.0
    return meant


def _exact_deg(word: str, angle: float, rounded: dict[str, float]) -> float:
    """Do the same for deg that were converted from such rad: 90.0002 from 1.5708."""
    multiple = round(angle / 45.0)
    digits = len(word.partition(".")[2])
    made = [math.degrees(each) for d in range(2, 7) for each in _cut(multiple * _EIGHTH, d)]
    if multiple == 0 or digits < 3 or min(abs(angle - each) for each in made) > 0.51 * 10.0**-digits:
        return angle
    if abs(angle - multiple * 45.0) > 1e-9:
        rounded[f"{word} deg"] = multiple * 45.0
    return multiple * 45.0


def _cut(meant: float, digits: int) -> tuple[float, float]:
    """Round a number to some digits, and truncate it to the same."""
    return round(meant, digits), math.trunc(meant * 10.0**digits) / 10.0**digits


def _terms(text: str) -> Iterator[tuple[float, bool] | None]:
    """Yield every term of a sum, and whether it holds pi; yield None at any other text."""
    at = 0
    while at < len(text):
        found = _TERM.match(text, at)
        if found is None or found.end() == at or not (found[2] or found[3]) or (at > 0 and not found[1]):
            yield None
            return
        value = 1.0 if found[2] is None else _float(found[2])
        value *= math.pi if found[3] else 1.0
        value /= 1.0 if found[4] is None else (_float(found[4]) or math.nan)
        yield (-value if found[1] == "-" else value), bool(found[3])
        at = found.end()
        while at < len(text) and text[at] == " ":
            at += 1


def _float(text: str) -> float:
    return float(text.replace(",", "."))
