"""KUKA programs (.src, .dat): POS, E6POS, FRAME, AXIS and E6AXIS.

They are declared, assigned or written into the motion.

    DECL E6POS XP1={X 500.0,Y 0.0,Z 300.0,A 0.0,B 90.0,C 0.0,S 2,T 10,E1 0.0,...}
    DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,...}     tool and base of XP1
    PTP {A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}

Units are mm and deg. A, B and C turn about z, y' and x'': R = Rz(A) Ry(B) Rx(C). Bit 0 of S says whether the
wrist is in front of axis 1 or behind it. Bit 1 selects the elbow with the larger A3. Bit k of T says that axis
k + 1 is negative. S and T are read together: the one posture that fits both is meant, and none is guessed. One
statement fills one line.

Tool and base are those of the FDAT. Without one they are those of $TOOL, $BASE or BAS before the motion, by
number. 0 is the flange, and the world in which the robot is without an offset. Sources are descriptions of the
language and public programs. It was not tried on a controller.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from calib.arm import BRANCHES
from calib.array import Array
from calib.compensate import inverse_poses
from calib.units import DEG
from service.programs import frames
from service.programs.frames import UNNAMED, KnownFrames
from service.programs.program import NewTarget, ProgramTarget, Window, beside, rules
from service.programs.text import Edit, Lines, Number, decimal

PLACES = 5  # mm and deg; the controller keeps some seven digits
_ROUNDING = 1e-6 * DEG
_LINE = re.compile(r"[^\r\n]++")
_CODE = re.compile(r'(?:[^;"\r\n]++|"[^"\r\n]*+")*+')
_AGGREGATE = re.compile(r"\{([^{}]*+)\}")
_DECLARED = re.compile(
    r"\s*+(?:GLOBAL\s++)?(?:DECL\s++)?(?:GLOBAL\s++)?(?:(?P<type>E6POS|POS|FRAME|E6AXIS|AXIS|FDAT)\s++)?"
    r"(?P<name>[A-Z_]\w*+(?:\[\s*+\d{1,6}+\s*+\])?)\s*+=\s*+(?=\{)",
    re.IGNORECASE,
)
_MOTION = re.compile(r"\s*+(?P<verb>S?(?:PTP|LIN|CIRC)(?P<rel>_REL)?+|SPL)\s++(?P<rest>.*+)", re.IGNORECASE)
_SET = re.compile(r"\s*+\$(?P<which>TOOL|BASE)\s*+=\s*+(?P<value>.*+)", re.IGNORECASE)
_BAS = re.compile(r"\s*+BAS\s*+\(\s*+#(?P<which>TOOL|BASE)\s*+,\s*+(?P<value>\d{1,3}+)\s*+\)", re.IGNORECASE)
_FDAT = re.compile(r"\s*+FDAT_ACT\s*+=\s*+(?P<name>[A-Z_]\w*+)\s*+", re.IGNORECASE)
_BRANCH = re.compile(
    r"\s*+(?:(?:GLOBAL\s++)?(?:DEF|DEFFCT)|END|IF|ELSE|ENDIF|FOR|ENDFOR|WHILE|ENDWHILE|REPEAT|UNTIL|LOOP|ENDLOOP"
    r"|SWITCH|CASE|DEFAULT|ENDSWITCH|GOTO)\b|\s*+\w++\s*+:\s*+$",
    re.IGNORECASE,
)
_ROUTINE = re.compile(r"\s*+(?:GLOBAL\s++)?DEF(?:FCT\s++\w++)?\s++(?P<name>[A-Z_]\w*+)", re.IGNORECASE)
_DATA = re.compile(r"(?:TOOL|BASE)_DATA\s*+\[\s*+(\d{1,3}+)\s*+\]\s*+", re.IGNORECASE)
_FIELD = re.compile(
    r"\s*+(?P<name>[A-Z]\w*+(?:\[\])?)\s++(?P<value>[-+]?(?:\d++\.?\d*+|\.\d++)(?:E[-+]?\d{1,3}+)?)?",
    re.IGNORECASE,
)
_POSE, _AXES = ("X", "Y", "Z", "A", "B", "C"), ("A1", "A2", "A3", "A4", "A5", "A6")
_POINT = r"(?:[A-Z_]\w*+(?:\[\s*+\d++\s*+\])?+|\{\})"
# Parts of a motion that do not change its points.
_PLAIN = re.compile(
    rf"(?P<points>{_POINT}(?:\s*+,\s*+{_POINT})?+)(?:\s*+,\s*+CA\s++[-+.\w]++)?+(?:\s++C_[A-Z]++)*+"
    r"(?:\s++WITH\b(?:(?!\$(?:TOOL|BASE|IPO_MODE)\s*+=\s*+(?!S\w++\s*+\(\s*+F)).)*+)?+\s*+",
    re.IGNORECASE,
)
_HERE = re.compile(r"\$(?:POS|AXIS)_ACT\s*+", re.IGNORECASE)
_NAME = re.compile(r"(?<![\w.#$])[A-Z_]\w*+(?:\[\s*+\d++\s*+\])?+", re.IGNORECASE)
_RULES = rules(
    displaces=r"^\s*+\$IPO_MODE\s*+=\s*+#TCP\b|\b(?:RSI_(?:ON|MOVECORR)|TM_[A-Z]\w*+)\b|^\s*+BAS\s*+\(\s*+#EX_BASE\b"
    r"|\bCORR_ON\b|^\s*+(?:TOOL|BASE)_DATA\s*+\[[^\]]*+\]\s*+(?:\.\s*+\w++\s*+)?+=|^\s*+\$(?:TOOL|BASE)\s*+\."
    r"|^\s*+(?:PTP_)?SPLINE\b.*\$(?:TOOL|BASE|IPO_MODE)\s*+=|^\s*+\$(?:ROBROOT|WORLD)\s*+(?:\.\s*+\w++\s*+)?+=",
    loads=r"^\s*+(?:\$(?:ADD)?LOAD(?:_A\d)?\b|LOAD_DATA\b|SET_LOAD\b)[^=]*+=?+",
)
_OPTION = {"TOOL": "--tool", "BASE": "--frame"}
_UNSURE = "?"  # a tool or base that depends on which way the program took


_Frames = Callable[[], tuple[Array, Array]]
"""Finds (4, 4) tool and base of a target. Raises ValueError, saying why there are none."""


@dataclass(frozen=True)
class _KukaPlace:
    """The places of a target's numbers in the text, and the frame in which it counts."""

    at: int
    numbers: Mapping[str, Number] = field(default_factory=dict)
    frame: Array = field(default_factory=lambda: np.eye(4))


@dataclass(frozen=True)
class _Valid:
    """The tool and base in force at a motion, or at a point by its FDAT.

    Each is a pose, or the number or name of one; it is None if the file does not state it.
    """

    tool: Array | str | None = None
    base: Array | str | None = None
    outside: bool = False  # the tool is fixed in the cell


class KukaProgram:
    """A .src or .dat file. Lines that hold no target are left alone."""

    def __init__(self, text: str, file: str, world: Array, known: KnownFrames) -> None:
        self.text = text
        self._lines = Lines(text, file)
        self._world, self._known = world, known
        self._statements = [(m.start(), _code(m.group())) for m in _LINE.finditer(text)]
        self._fdat: dict[str, _Valid] = {}
        for name, valid in self._read_fdat():
            twice = self._fdat.setdefault(name, valid) != valid
            self._fdat[name] = _Valid(_UNSURE, _UNSURE) if twice else valid
        self._odd = dict[str, str]()
        self._used = self._read_uses()
        self._met: dict[str, tuple[Array, Array] | str] = {}
        found = beside(list(self._read()), self._statements, _RULES, self._lines, _KukaPlace(0))
        self.targets: Sequence[ProgramTarget] = tuple(target for target, _ in found)
        self._places = tuple(place for _, place in found)

    def edits(self, index: int, driven: NewTarget) -> list[Edit]:
        """Return edits of the numbers that differ, and of T if an axis changes its sign."""
        target, place = self.targets[index], self._places[index]
        if target.joints is not None:
            return _changed(place, dict(zip(_AXES, np.degrees(driven.joints), strict=True)))
        pose = inverse_poses(place.frame) @ driven.flange @ target.tool
        old = [place.numbers[name].value for name in ("C", "B", "A")]
        c, b, a = frames.wpr(pose, old)
        out = _changed(place, dict(zip(_POSE, [*pose[:3, 3], a, b, c], strict=True)))
        if (turn := place.numbers.get("T")) is not None:
            bits = sum(1 << k for k, q in enumerate(driven.joints) if q < -_ROUNDING)
            fits = not _outside(driven.joints, _signs(int(turn.value)))
            kept = int(turn.value) if fits else int(turn.value) & ~0b111111 | bits
            out += [] if kept == int(turn.value) else [Edit(turn.start, turn.end, str(kept))]
        return out

    # -- reading ------------------------------------------------------------------------------------------

    def _read_fdat(self) -> Iterator[tuple[str, _Valid]]:
        for at, code in self._statements:
            match = _DECLARED.match(code)
            if match is None or (match["type"] or "").upper() != "FDAT":
                continue
            body = _AGGREGATE.match(code, match.end())
            if body is None:
                continue
            numbers = _numbers(body[1], at + body.start(1))
            outside = re.search(r"IPO_FRAME\s++#TCP\b", body[1], re.IGNORECASE) is not None
            of = [str(int(numbers[key].value)) if key in numbers else None for key in ("TOOL_NO", "BASE_NO")]
            yield _name(match["name"]), _Valid(of[0], of[1], outside)

    def _settings(self) -> Iterator[tuple[int, dict[str, Array | str | None]]]:
        """Return the statements that set the tool or the base, by their position in the text."""
        for at, code in self._statements:
            if (match := _SET.match(code) or _BAS.match(code)) is not None:
                yield at, {match["which"].lower(): self._named(match["value"].strip(), at)}
            elif (match := _FDAT.fullmatch(code)) is not None:
                of = self._fdat.get(_name(match["name"]), _Valid())
                yield at, {"tool": of.tool, "base": of.base}

    def _in_order(self) -> Iterator[tuple[int, str, _Valid]]:
        """Return every statement with the tool and the base in force.

        If the file sets several, one is known only while the statements behind it follow one another. The branches of
        a program are not followed.
        """
        settings = dict(self._settings())
        kinds = {"tool": set[object](), "base": set[object]()}
        for each in settings.values():
            for which, value in each.items():
                kinds[which].add(value.tobytes() if isinstance(value, np.ndarray) else value)
        several = {which: _UNSURE for which, values in kinds.items() if len(values) > 1}
        own = {_name(m["name"]) for _, code in self._statements if (m := _ROUTINE.match(code))}
        valid = _Valid()
        for at, code in self._statements:
            if at in settings:
                valid = replace(valid, **settings[at])
            elif _BRANCH.match(code) or (own and own & set(map(_name, _NAME.findall(code)))):
                valid = replace(valid, **several)
            yield at, code, valid

    def _read_uses(self) -> dict[str, list[_Valid]]:
        """Map the name of a point to the tool and base at each motion to it.

        Other uses of a point go into `_odd`.
        """
        out: dict[str, list[_Valid]] = {}
        for at, code, valid in self._in_order():
            declared, plain = _DECLARED.match(code), _plain(code)
            if plain is not None:
                for name in map(_name, _NAME.findall(plain["points"])):
                    out.setdefault(name, []).append(valid)
                continue
            of_declared = "" if declared is None else _name(declared["name"])
            for name in map(_name, _NAME.findall(_AGGREGATE.sub("{}", code))):
                if name != of_declared:
                    line = self._lines.at(at)
                    self._odd.setdefault(name, f"is also used in line {line}, which is not read here")
        return out

    def _read(self) -> Iterator[tuple[ProgramTarget, _KukaPlace]]:
        missing = set(self._used) - {
            _name(m["name"]) for _, code in self._statements if (m := _DECLARED.match(code))
        }
        for at, code, valid in self._in_order():
            declared, motion = _DECLARED.match(code), _MOTION.match(code)
            line = self._lines.at(at)
            if declared is not None and (declared["type"] or "").upper() != "FDAT":
                body = _AGGREGATE.match(code, declared.end())
                name = declared["name"]
                if body is not None and _is_target(body[1]):
                    of = partial(self._declared, _name(name))
                    odd = self._odd.get(_name(name)) or self._odd.get(_name(name).partition("[")[0], "")
                    yield self._target(
                        ProgramTarget(name, line, refused=odd), body[1], at + body.start(1), of
                    )
            elif motion is not None:
                plain, why = _plain(code), ""
                if plain is None:
                    why = f"'{code.strip()[:40]}' is not read here: where it drives to stays as it is"
                    why = "is a distance, not a place" if motion["rel"] else why
                for name in map(_name, _NAME.findall("" if plain is None else plain["points"])):
                    if name in missing:
                        missing.remove(name)
                        yield ProgramTarget(name, line, refused="is not in this file"), _KukaPlace(at)
                bodies = list(_AGGREGATE.finditer(code, motion.start("rest")))
                for body in bodies:
                    of = partial(self._tool_and_base, [valid])
                    target = ProgramTarget(f"line {line}", line, refused=why)
                    yield self._target(target, body[1], at + body.start(1), of)
                if why and not bodies and not _HERE.fullmatch(motion["rest"]):
                    yield ProgramTarget(f"line {line}", line, refused=why), _KukaPlace(at)

    def _of(self, name: str) -> list[_Valid]:
        """Return tool and base of a declared point.

        They are those of its FDAT, or of the motions to it, or of the command line, in this order.
        """
        fdat = self._fdat.get(f"F{name[1:]}") if name[:1] == "X" else None
        used = self._used.get(name, [])
        if fdat is None:
            return used or [_Valid()]
        return [
            fdat,
            *(replace(fdat, tool=_or(each.tool, fdat.tool), base=_or(each.base, fdat.base)) for each in used),
        ]

    def _declared(self, name: str) -> tuple[Array, Array]:
        """Return tool and base of a declared point.

        They are found once, even if it is declared several times.

        Raises
        ------
        ValueError
            They cannot be found.
        """
        if name not in self._met:
            try:
                self._met[name] = self._tool_and_base(self._of(name))
            except ValueError as error:
                self._met[name] = str(error)
        met = self._met[name]
        if isinstance(met, str):
            raise ValueError(met)
        return met

    def _target(
        self, target: ProgramTarget, body: str, at: int, of: _Frames
    ) -> tuple[ProgramTarget, _KukaPlace]:
        place = _KukaPlace(at, _numbers(body, at))
        if target.refused:
            return target, place
        try:
            return self._understood(target, place, body, of)
        except ValueError as error:
            return replace(target, refused=str(error)), place

    def _understood(
        self, target: ProgramTarget, place: _KukaPlace, body: str, of: _Frames
    ) -> tuple[ProgramTarget, _KukaPlace]:
        """Return a target with its joints or pose, and its place.

        Raises
        ------
        ValueError
            Its joints cannot be found; the message has the reason.
        """
        numbers = place.numbers
        wanted = _AXES if "A1" in numbers or not set(_POSE) & set(numbers) else _POSE
        if missing := [key for key in wanted if key not in numbers]:
            raise ValueError(
                f"it has no number for {missing[0]}, which is then kept or computed by the controller"
            )
        if len(numbers) != len({name.upper() for name in numbers}) or _repeated(body):
            raise ValueError("a component is given twice")
        values = [numbers[key].value for key in wanted]
        if wanted is _AXES:
            return replace(target, joints=frames.joint_angles(np.array(values) * DEG)), place
        used = any(re.fullmatch(r"E\d", key) and slot.value != 0.0 for key, slot in numbers.items())
        target = replace(target, notes=self._known.note_external(used=used))
        x, y, z, a, b, c = values
        pose = frames.of_wpr((x, y, z), (c, b, a))
        tool, base = of()
        frame = self._world @ base
        status, turn = (numbers.get(key) for key in ("S", "T"))
        target = replace(target, flange=frame @ pose @ inverse_poses(tool), tool=tool)
        if status is not None and turn is not None:
            side = "back" if int(status.value) & 1 else "front"
            target = replace(
                target,
                among=tuple(branch for branch in BRANCHES if branch.startswith(side)),
                windows=_signs(int(turn.value)),
                larger_elbow=bool(int(status.value) & 2),
                turns_written=True,
                kept=frozenset({2, 4}),  # S, which stays as it is, would be another
            )
        elif status is not None or turn is not None:
            raise ValueError("it has only one of S and T, which leaves several postures")
        return target, replace(place, frame=frame)

    def _tool_and_base(self, of: list[_Valid]) -> tuple[Array, Array]:
        if any(valid.outside for valid in of):
            raise ValueError("its tool is fixed in the cell (IPO_FRAME #TCP)")
        found = [(self._pose(valid.tool, "TOOL"), self._pose(valid.base, "BASE")) for valid in of]
        if any(not np.allclose(np.array(each), np.array(found[0]), atol=1e-9) for each in found[1:]):
            raise ValueError("it is used with several tools or bases: one correction cannot serve them")
        return found[0]

    def _pose(self, value: Array | str | None, which: str) -> Array:
        """Return the pose (4, 4) of a tool or base.

        Raises
        ------
        ValueError
            It is not known; the message names it.
        """
        if isinstance(value, np.ndarray):
            return value
        option = _OPTION[which]
        table = self._known.tools if which == "TOOL" else self._known.frames
        if value is None and UNNAMED in table:
            return table[UNNAMED]
        if value is None:
            raise ValueError(
                f"its {which.lower()} is not in this file: give {option} x,y,z,w,p,r (w is C, p B, r A)"
            )
        if value == _UNSURE:
            raise ValueError(
                f"which {which.lower()} it is driven with is computed, or depends on the way that the program takes: "
                f"set ${which} by number in the lines before its motion"
            )
        if value.lower() in table:
            return table[value.lower()]
        if value == "0":
            return np.eye(4)
        raise ValueError(
            f"its {which.lower()} {value} is not in this file: give {option} {value}=x,y,z,w,p,r"
        )

    def _named(self, value: str, at: int) -> Array | str:
        """Return the value that $TOOL or $BASE is set to."""
        if value.isdecimal() or re.fullmatch(r"[A-Za-z_]\w*+", value):
            return value
        if value.upper() == "$NULLFRAME":
            return np.eye(4)
        if (data := _DATA.fullmatch(value)) is not None:
            return data[1]
        body = _AGGREGATE.fullmatch(value)
        numbers = {} if body is None else _numbers(body[1], at)
        if any(key not in numbers for key in _POSE):
            return _UNSURE
        x, y, z, a, b, c = (numbers[key].value for key in _POSE)
        try:
            return frames.of_wpr((x, y, z), (c, b, a))
        except ValueError:
            return _UNSURE


def _code(line: str) -> str:
    """Return a line without its comment."""
    match = _CODE.match(line)
    return "" if match is None else match.group()


def _or(value: Array | str | None, of_point: Array | str | None) -> Array | str | None:
    """Return the tool or base of a motion if it is known, or that of its point."""
    return of_point if value is None or (isinstance(value, str) and value == _UNSURE) else value


def _name(written: str) -> str:
    """Return a name in the form for comparison: in capitals, without blanks."""
    return re.sub(r"\s", "", written).upper()


def _plain(code: str) -> re.Match[str] | None:
    """Match a motion that is fully understood, its aggregates left out.

    Returns None for other statements.
    """
    motion = _MOTION.match(code)
    return None if motion is None or motion["rel"] else _PLAIN.fullmatch(_AGGREGATE.sub("{}", motion["rest"]))


def _is_target(body: str) -> bool:
    names = {part.split()[0].upper() for part in body.split(",") if part.split()}
    return bool(names) and (names >= {"X"} or "A1" in names)


def _repeated(body: str) -> bool:
    names = [part.split()[0].upper() for part in body.split(",") if part.split()]
    return len(set(names)) != len(names)


def _numbers(body: str, at: int) -> dict[str, Number]:
    """Return the plain numbers of an aggregate by component, in capitals.

    The body begins at `at` of the text.
    """
    out, begin = {}, 0
    for part in body.split(","):
        match = _FIELD.fullmatch(part.rstrip())
        if match is not None and match["value"] is not None and math.isfinite(float(match["value"])):
            start = at + begin + match.start("value")
            out[match["name"].upper()] = Number(start, start + len(match["value"]), float(match["value"]))
        begin += len(part) + 1
    return out


def _signs(turn: int) -> dict[int, Window]:
    """Range of each axis, rad, by the bits of T."""
    whole = 360.0 * DEG
    return {k: (-whole, _ROUNDING) if turn >> k & 1 else (-_ROUNDING, whole) for k in range(len(_AXES))}


def _outside(joints: Array, windows: Mapping[int, Window]) -> bool:
    return any(not begin <= joints[k] <= end for k, (begin, end) in windows.items())


def _changed(place: _KukaPlace, values: Mapping[str, float]) -> list[Edit]:
    out = []
    for name, value in values.items():
        slot = place.numbers[name]
        off = value - slot.value
        if name in ("A", "B", "C"):
            off = (off + 180.0) % 360.0 - 180.0
        if abs(off) > 0.5 * 10.0**-PLACES:
            out.append(Edit(slot.start, slot.end, decimal(float(value), PLACES)))
    return out
