"""The words with which DH tables name their columns, and what their cells hold: `90`, `-pi/2`, `q2 + 90`, `12,5`."""

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
_INDEX = re.compile(r"_?(?:\{?(?:i|k|j|n)(?:\s*-\s*1)?\}?)$")
_JOINT = re.compile(r"(?<![a-zθ])(?:q|θ|theta|th|d|s)_?\d+\*?(?!\d)|\bq\b|\bvar(?:iable)?\b|^\*$")
_NUMBER = r"\d+(?:[.,]\d*)?(?:e[+-]?\d+)?|[.,]\d+(?:e[+-]?\d+)?"
_TERM = re.compile(
    rf"([+-]?)\s*(?:({_NUMBER})\s*°?\s*\*?\s*)?(pi|π)?\s*(?:/\s*({_NUMBER}))?\s*(?:deg|rad|mm|m|°)?"
)


@dataclass(frozen=True)
class Heading:
    """The quantity of a column (None: nothing that is read), and the unit in its name ("" where it names none)."""

    meaning: str | None
    unit: str


@dataclass(frozen=True)
class Cell:
    """The number of a cell; whether it is a multiple of pi, and whether it contains the joint's own variable."""

    value: float
    pi: bool = False
    variable: bool = False


def heading(text: str) -> Heading:
    """The meaning of a column's name: `alpha_{i-1} [deg]` is alpha in degrees."""
    if len(text) > _LONGEST:
        return Heading(None, "")
    word, unit = text.strip().lower().replace("−", "-"), ""
    if found := _UNIT.search(word):
        unit = next((unit for unit, words in _UNITS.items() if found[1] in words), "")
        word = word[: found.start()] if unit else word
    word = word.strip().strip("()[]")
    for shape in (word, _INDEX.sub("", word)):
        plain = re.sub(r"[\s_\-{}.()]+", "", shape)
        for meaning, words in _WORDS.items():
            if plain in words:
                return Heading(meaning, unit)
    return Heading(None, unit)


def cell(text: str) -> Cell | None:
    """The number that a cell means; None where it means none. Empty and a dash are 0."""
    if len(text) > _LONGEST:
        return None
    word = text.strip().lower().replace("−", "-").replace("–", "-")
    if word in ("", "-"):
        return Cell(0.0)
    rest, variables = _JOINT.subn("", word)
    if variables > 1 or re.search(r"-\s*$|-\s*[qθ]", word):
        return None  # a joint that counts the other way needs more than a number
    rest = rest.strip().removeprefix("+").strip()
    if not rest:
        return Cell(0.0, variable=True)
    terms = list(_terms(rest))
    if not terms or None in terms:
        return None
    found = [term for term in terms if term is not None]
    value = sum(value for value, _ in found)
    return Cell(value, any(pi for _, pi in found), variables > 0) if math.isfinite(value) else None


def _terms(text: str) -> Iterator[tuple[float, bool] | None]:
    """Every term of a sum, with whether it holds pi; None where there is anything else."""
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
