"""Meaning of column names, English and German, if it can be recognised.

`Achse 1`, `J1`, `theta_1`, `A1` are joint 1. `X`, `Pos. X`, `x_ist`, `T2 X meas` are coordinates with a
role and a target. `A`, `B`, `C` are angles of KUKA, `W`, `P`, `R` of Fanuc; `rx` and the like belong to
no maker. Other names are unknown, and the map leaves their columns out.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from calib.foreign.files.layout import LONGEST, split

Kind = Literal[
    "joint", "external", "point", "angle", "quaternion", "id", "target", "time", "temperature", "status", "set",
    "series", "waypoint", "visit", "spread", "deviation", "matrix", "other",
]  # fmt: skip
Role = Literal["", "measured", "nominal", "read", "own"]


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_NOMINAL = _words(
    "nom nominal soll cmd command commanded theo theoretical cad ref reference programmed prog desired "
    "setpoint planned target ziel vorgabe"
)
_MEASURED = _words(
    "meas measured ist act actual gemessen mess messwert messung measurement tracker laser smr lt "
    "instrument leica faro api read readback feedback fb encoder istwert gelesen rückgelesen"
)
_OWN = frozenset(["tcp", "flange", "flansch", "controller", "steuerung", "robot", "roboter", "tool0"])
_DEVIATION = _words("dev deviation delta diff difference error err abw abweichung fehler residual")
_SPREAD = _words("sigma std stdev unc uncertainty u unsicherheit stabw rms tol tolerance toleranz")
_FILL = _words(
    "pos position coord coordinate koord koordinate value wert point punkt in of the joint joints achse "
    "achsen axis axes gelenk gelenke winkel angle angles gelenkwinkel achswinkel robax frame wcs world "
    "welt"
)
_JOINT = _words("j gelenkwinkel achswinkel joint axis achse gelenk axe theta th θ q a rax ax s phi robax")
_EXTERNAL = frozenset(["e", "ext", "external", "eax", "extern", "zusatzachse", "track"])
_ROS = ("shoulder pan", "shoulder lift", "elbow", "wrist 1", "wrist 2", "wrist 3")
_UR = ("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3")
_GROUP = _words(
    "t tool werkzeug smr target marker ball prism prisma reflektor reflector kugel m p punkt point nest "
    "messpunkt"
)
_TIME = _words("time timestamp zeit zeitstempel t datetime uhrzeit date datum stamp")
_ID = _words(
    "id nr no number nummer index # name point punkt punktname pose messpunkt reading label pointname "
    "feature bezeichnung messung measurement idx n count sample punktnr"
)
_TARGET = _words("target smr marker reflector reflektor ziel tool werkzeug prisma prism")
_STATUS = _words("status valid gültig gueltig ok quality qualität state zustand flag result")
_TEMPERATURE = frozenset(["temp", "temperature", "temperatur", "lufttemperatur"])
_ANGLES = {
    "rx": ("rx", "ry", "rz"),
    "abc": ("a", "b", "c"),
    "wpr": ("w", "p", "r"),
    "rpy": ("roll", "pitch", "yaw"),
}
_KINDS: tuple[tuple[Kind, frozenset[str]], ...] = (
    ("waypoint", frozenset({"waypoint", "wegpunkt"})),
    ("series", frozenset({"series", "serie"})),
    ("set", frozenset({"set"})),
    ("visit", frozenset({"visit", "besuch"})),
    ("status", _STATUS),
)
_SPLIT = re.compile(r"[^\W\d_]+|\d+|#")


@dataclass(frozen=True)
class ColumnMeaning:
    """Meaning of a column's name.

    Attributes
    ----------
    index : int
        Number of a joint (0 if counted from 0), or which of x, y, z.
    family : str
        For angles, how they are named.
    group : str
        Target to which the column belongs.
    unit : str
        Unit in the name.
    """

    kind: Kind
    index: int = 0
    role: Role = ""
    family: str = ""
    group: str = ""
    unit: str = ""


def meaning_of(name: str) -> ColumnMeaning:
    """Find the meaning of a column's name."""
    if len(name) > LONGEST:
        return ColumnMeaning("other")
    bare, unit = split(re.sub(r"#\d+$", "", name))
    tokens = [token.lower() for token in _SPLIT.findall(bare)]
    tokens = [part for token in tokens for part in _unglued(token)]
    words = set(tokens)
    role: Role = (
        "measured" if words & _MEASURED else "nominal" if words & _NOMINAL else "own" if words & _OWN else ""
    )
    if words & _DEVIATION or any(re.fullmatch(r"d[xyz]", token) for token in tokens):
        return ColumnMeaning("deviation", unit=unit)
    if "d" in tokens and words & set("xyz"):
        return ColumnMeaning("deviation", unit=unit)
    if words & {"ux", "uy", "uz"} or (words & _SPREAD and words & (set("xyz") | {"rms"})):
        return ColumnMeaning("spread", unit=unit)
    for kind in (_joint, _rotation, _point):
        if (found := kind(tokens, role, unit)) is not None:
            return found
    return _other(tokens, words, unit)


def _unglued(token: str) -> list[str]:
    """Split a name of two words that are written as one.

    Examples are `posx` to pos x, `xist` to x ist and `xmeas` to x meas.
    """
    for word in sorted(_FILL | _NOMINAL | _MEASURED | _OWN | {"dev"}, key=len, reverse=True):
        if len(word) >= 3 and len(token) == len(word) + 1:
            if token.startswith(word) and token[-1] in "xyz":
                return [word, token[-1]]
            if token.endswith(word) and token[0] in "xyz":
                return [token[0], word]
    return [token]


def _joint(tokens: list[str], role: Role, unit: str) -> ColumnMeaning | None:
    text = " ".join(
        token for token in tokens if token not in _MEASURED | _NOMINAL | {"joint", "winkel", "angle"}
    )
    for names in (_ROS, _UR):
        if text in names and (names is _ROS or unit in ("deg", "rad", "")):
            return ColumnMeaning(
                "joint",
                names.index(text) + 1,
                _of_joint(role, tokens),
                "ros" if names is _ROS else "ur",
                unit=unit,
            )
    numbers = [i for i, token in enumerate(tokens) if token.isdigit()]
    if len(numbers) != 1 or len(tokens[numbers[0]]) > 2:
        return None
    at = numbers[0]
    rest = [*tokens[:at], *tokens[at + 1 :]]
    names = [token for token in rest if token in _JOINT]
    others = [token for token in rest if token not in _JOINT | _FILL | _MEASURED | _NOMINAL | _OWN]
    if at and tokens[at - 1] in _EXTERNAL and not [token for token in others if token not in _EXTERNAL]:
        return ColumnMeaning("external", int(tokens[at]), _of_joint(role, tokens), unit=unit)
    before = [token for token in tokens[:at] if token not in _MEASURED | _NOMINAL]
    if not names or others or (before and before[-1] not in _JOINT | _FILL):
        return None
    return ColumnMeaning("joint", int(tokens[at]), _of_joint(role, tokens), names[-1], unit=unit)


def _of_joint(role: Role, tokens: list[str]) -> Role:
    return "read" if role == "measured" else role if role == "nominal" else ""


def _rotation(tokens: list[str], role: Role, unit: str) -> ColumnMeaning | None:
    text = [
        token
        for token in tokens
        if token not in _MEASURED | _NOMINAL | _OWN | _FILL | {"euler", "rot", "rotation"}
    ]
    turned = bool({"euler", "rot", "rotation"} & set(tokens))
    if len(text) == 1 and (match := re.fullmatch(r"(?:q|quat|rot)?([wxyz])", text[0])):
        if text[0][0] == "q":
            return ColumnMeaning("quaternion", "wxyz".index(match[1]), role, "named", unit=unit)
        if text[0] in "xyz" and turned:
            return ColumnMeaning("angle", "xyz".index(text[0]), role, "rx", unit=unit)
        if text[0] == "w" and turned:
            return ColumnMeaning("quaternion", 0, role, "named", unit=unit)
    if len(text) == 2 and text[0] in ("q", "quat", "quaternion"):
        if text[1] in "wxyz":
            return ColumnMeaning("quaternion", "wxyz".index(text[1]), role, "named", unit=unit)
        if text[0] != "q" and text[1].isdigit():
            return ColumnMeaning("quaternion", int(text[1]), role, "numbered", unit=unit)
    if len(text) != 1:
        return None
    for family, names in _ANGLES.items():
        if text[0] in names:
            return ColumnMeaning("angle", names.index(text[0]), role, family, unit=unit)
    return None


def _point(tokens: list[str], role: Role, unit: str) -> ColumnMeaning | None:
    axes = [token for token in tokens if token in ("x", "y", "z")]
    glued = [re.fullmatch(r"(?:p|t|m)?([xyz])(\d*)", token) for token in tokens]
    if len(axes) != 1:
        if len(tokens) == 1 and glued[0]:
            axes = [glued[0][1]]
        else:
            return None
    rest = [token for token in tokens if token != axes[0]]
    known = _FILL | _MEASURED | _NOMINAL | _OWN
    group = ""
    for i, token in enumerate(rest):
        if token.isdigit():
            before = rest[i - 1] if i and rest[i - 1] in _GROUP else ""
            group = (before.upper() if len(before) < 4 else before.capitalize()) + token
            rest = [other for other in rest if other not in (token, before)]
            break
    if [
        token for token in rest if token not in known and len(token) > 1 and token not in ("p", "t", "m")
    ] and len(tokens) > 1:
        return None
    return ColumnMeaning("point", "xyz".index(axes[0]), role, group=group, unit=unit)


def _other(tokens: list[str], words: set[str], unit: str) -> ColumnMeaning:
    first = tokens[0] if tokens else ""
    if words & _TEMPERATURE or (unit == "c" and first == "t"):
        return ColumnMeaning("temperature", unit=unit)
    if words & _TIME and not words & (_ID - {"stamp"}):
        return ColumnMeaning("time", family="date" if words & {"date", "datum"} else "", unit=unit)
    for kind, names in _KINDS:
        if words & names and len(tokens) <= 2:
            return ColumnMeaning(kind, unit=unit)
    if words & _TARGET and len(tokens) <= 3:
        return ColumnMeaning("target", unit=unit)
    if words & _ID and len(tokens) <= 3:
        return ColumnMeaning("id", family="pose" if words & {"pose"} else "", unit=unit)
    return ColumnMeaning("other", unit=unit)
