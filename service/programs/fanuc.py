"""Fanuc .ls programs: Cartesian or joint positions of motion group 1 in /POS.

    P[2:"name"]{
       GP1:
        UF : 0, UT : 1,  CONFIG : 'N U T, 0, 0, 0',
        X = 600.000 mm, Y = -12.500 mm, Z = 900.000 mm, W = 180.000 deg, P = -.131 deg, R = -90.000 deg
    };

CONFIG is N/F (no flip or flip), U/D (up or down), T/B (toward, that is front, or back), then the whole turns of
J1, J4, J6. Its text is kept. `********` is a position that was never taught. Poses count in user frame UF of
the controller's world, whose origin the robot file names. Neither frame nor tool is in the file. The format
holds three decimals. The source is the maker's ASCII program listing.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib.array import Array
from calib.compensate import inverse_poses
from calib.errors import DataError
from calib.units import DEG
from service.programs import frames
from service.programs.frames import KnownFrames
from service.programs.program import TWICE, NewTarget, ProgramTarget, Window, beside, rules
from service.programs.text import Edit, Lines

PLACES = 3

# Every repetition is possessive, and none can run over the beginning of another position: time grows with the text.
_POSITION = re.compile(
    r"\bP\[\s*+(?P<number>\d{1,9}+)\s*+(?::(?P<comment>[^\[\]]*+))?\]\s*+\{(?P<body>[^{}]*+)\}\s*+;"
)
_GROUP = re.compile(r"\bGP(\d++)\s*+:")
_FRAMES = re.compile(r"\bUF\s*+:\s*+(\w++)\s*+,\s*+UT\s*+:\s*+(\w++)")
_CONFIG = re.compile(r"\bCONFIG\s*+:\s*+'([^']*+)'")
_VALUE = re.compile(
    r"\b(?P<name>[XYZWPR]|[JE]\d)\s*+="
    r"(?P<field>\s*+(?:(?P<number>[-+]?(?:\d++\.?\d*+|\.\d++))|(?P<none>\*++)))"
)
_USE = re.compile(r"(?<![A-Z])P\[\s*+(\d{1,9}+)[^\[\]]*+\]", re.IGNORECASE)
_STATEMENT = re.compile(r"(?:\s*+\d++\s*+:)?+(?P<code>[^;]*+);?+")
_ANY = r"(?:(?<![A-Z])P\[[^][]*+\]|(?<![A-Z])P\[\s*+A?R\[[^][]*+\][^][]*+\])"
_MOTION = re.compile(rf"\s*+[JLACS]\s++(?={_ANY}|PR\[)", re.IGNORECASE)
_DISTANCE = re.compile(r"\bINC\b", re.IGNORECASE)
# Parts of a motion that do not change its positions, and actions on its way.
_PLAIN = re.compile(
    rf"{_ANY}|:\s|(?<![A-Z])A?R\[[^][]*+\]|\b(?:FINE|PTH|WJNT|W/JNT|MROT|MPTH|BREAK|HOT_START|max_speed|WELD_SPEED)\b"
    r"|\b(?:CNT|CD|CR|ACC|EV|Ind\.EV|RT_LD|AP_LD|PSPD|SLOWDOWN)\s*+\d*+%?+|\bSkip\s*+,\s*+LBL\[[^][]*+\]"
    r"|\b(?:Arc|Weave)\s++(?:Start|End|Sine)\b\s*+(?:\[[^][]*+\])?+"
    r"|\b(?:T[AB]|DB)\s++[-\d.]++\s*+(?:sec|mm)\s*+,\s*+(?:CALL\s++\w++\s*+(?:\([^()]*+\))?+|\w++\[[^][]*+\]\s*+=\s*+\w++)"
    r"|\d(?:mm/sec|cm/min|inch/min|deg/sec|msec|sec|mm)|[\d.%\s,]",
    re.IGNORECASE | re.DOTALL,
)
_ON_ITS_WAY = re.compile(r"\b(?:T[AB]|DB)\s", re.IGNORECASE)
_RULES = rules(
    drives=rf"^\s*+(?:GP\d++\s++)?[JLACS]\s++(?:{_ANY}[\s:]++)?(?:PR|PAL_\d++)\[[^\]]*+\]",
    displaces=r"(?<![A-Z_])(?:UFRAME|UTOOL|\$MNUFRAME|\$MNUTOOL)\[[^=]{0,80}+="
    r"|^\s*+(?:(?:LINE\s++)?Track|Touch\s++Offset|MP\s++Offset|RPM|Soft\s?+float|Follow\s++up|Force\s?+Ctrl)\b"
    r"|^\s*+LINE_TRACK_SCHEDULE_NUMBER\s*+:\s*+0*+[1-9]",
    loads=r"(?<![A-Z_])PAYLOAD\[.{0,80}\]",
)
_INDIRECT = re.compile(r"(?<![A-Z])P\[\s*+A?R\[", re.IGNORECASE)
_MOST_TURNS = 100
_POSE = ("X", "Y", "Z", "W", "P", "R")
_JOINTS = ("J1", "J2", "J3", "J4", "J5", "J6")
_TURNED = (0, 3, 5)  # joints 1, 4, 6
_LETTERS = ({"T": "front", "B": "back"}, {"U": "up", "D": "down"}, {"N": "noflip", "F": "flip"})


@dataclass(frozen=True)
class _Field:
    """One number, with the span of its blanks and digits; its value is None if never taught."""

    start: int
    end: int
    value: float | None


@dataclass(frozen=True)
class _FanucPlace:
    fields: Mapping[str, _Field] = field(default_factory=dict)
    frame: Array = field(default_factory=lambda: np.eye(4))


class FanucProgram:
    """A .ls program.

    Raises
    ------
    DataError
        The text is no program, or its /POS section cannot be read.
    """

    def __init__(self, text: str, file: str, world: Array, known: KnownFrames) -> None:
        self.text = text
        self._lines = Lines(text, file)
        self._file, self._world, self._known = file, world, known
        begin = re.search(r"^/POS\b", text, re.MULTILINE)
        if begin is None or re.search(r"^﻿?/PROG\b", text, re.MULTILINE) is None:
            raise DataError(
                "is not a Fanuc program: /PROG and /POS are missing.",
                do="Give an .ls file as the controller lists it.",
                file=file,
                line=1,
            )
        end = re.search(r"^/END\b", text[begin.end() :], re.MULTILINE)
        stop = len(text) if end is None else begin.end() + end.start()
        # The lines before the first instruction describe the program, also statement by statement.
        first = re.search(r"^/MN\b[^\r\n]*+", text[: begin.start()], re.MULTILINE)
        head = 0 if first is None else first.end()
        statements = [*_statements(text, 0, head), *_statements(text, head, begin.start())]
        self._any_odd = ""
        self._odd = self._used_oddly(statements)
        positions = list(_POSITION.finditer(text, begin.end(), stop))
        for number, count in Counter(int(m["number"]) for m in positions).items():
            self._odd |= {number: TWICE} if count > 1 else {}
        found = [self._position(m) for m in positions]
        self._refuse_leftovers(begin.end(), stop, len(found))
        found = beside(found, statements, _RULES, self._lines, _FanucPlace())
        self.targets: Sequence[ProgramTarget] = tuple(target for target, _ in found)
        self._places = tuple(place for _, place in found)

    def edits(self, index: int, driven: NewTarget) -> list[Edit]:
        """Return edits of the numbers that differ; each keeps the width of its field."""
        target, place = self.targets[index], self._places[index]
        if target.joints is not None:
            values = dict(zip(_JOINTS, np.degrees(driven.joints), strict=True))
        else:
            pose = inverse_poses(place.frame) @ driven.flange @ target.tool
            turned = frames.wpr(pose, [place.fields[name].value or 0.0 for name in _POSE[3:]])
            values = dict(zip(_POSE, [*pose[:3, 3], *turned], strict=True))
        out = []
        for name, value in values.items():
            slot = place.fields[name]
            off = value - (slot.value or 0.0)
            # W, P and R of -180 and 180 deg are the same.
            off = math.remainder(off, 360.0) if name in _POSE[3:] else off
            if abs(off) > 0.5 * 10.0**-PLACES:
                digits = f"{value + 0.0:.{PLACES}f}".replace("-0.000", "0.000")
                # At least one blank stays between '=' and the number.
                out.append(
                    Edit(slot.start, slot.end, digits.rjust(max(slot.end - slot.start, len(digits) + 1)))
                )
        return out

    def _position(self, match: re.Match[str]) -> tuple[ProgramTarget, _FanucPlace]:
        number, comment = match["number"], (match["comment"] or "").strip().strip('"')
        name = f"P[{number}:{comment}]" if comment else f"P[{number}]"
        target = ProgramTarget(name, self._lines.at(match.start()))
        begin, end = self._first_group(match)
        if begin == end:
            return replace(target, empty=True, notes=("has no position of group 1",)), _FanucPlace()
        body = self.text[begin:end]
        fields = {
            m["name"]: _Field(
                begin + m.start("field"), begin + m.end("field"), None if m["none"] else float(m["number"])
            )
            for m in _VALUE.finditer(body)
        }
        place = _FanucPlace(fields)
        wanted = _JOINTS if "J1" in fields else _POSE
        missing = [key for key in wanted if key not in fields]
        if missing:
            raise DataError(
                f"{name} has no {missing[0]}.", do="Correct the position.", file=self._file, line=target.line
            )
        if any(fields[key].value is None for key in wanted):
            return replace(target, empty=True, notes=("was never taught",)), place
        if odd := self._odd.get(int(number), self._any_odd):
            return replace(target, refused=odd), place
        values = [fields[key].value or 0.0 for key in wanted]
        try:
            if wanted is _JOINTS:
                return replace(target, joints=frames.joint_angles(np.array(values) * DEG)), place
            others = len(_GROUP.findall(match["body"])) > 1
            return self._pose(target, body, place, values, others=others)
        except ValueError as error:
            return replace(target, refused=str(error)), place

    def _pose(
        self, target: ProgramTarget, body: str, place: _FanucPlace, values: list[float], *, others: bool
    ) -> tuple[ProgramTarget, _FanucPlace]:
        """Read a Cartesian position.

        `others` says whether it positions another motion group as well.

        Raises
        ------
        ValueError
            Its joints cannot be found; the message has the reason.
        """
        used = others or any(name[0] == "E" and slot.value is not None for name, slot in place.fields.items())
        beside = self._known.note_external(used=used)
        of = _FRAMES.search(body)
        config = _CONFIG.search(body)
        if of is None or config is None:
            raise ValueError("it has no UF, UT or CONFIG")
        frame = self._world @ self._frame(of[1], self._known.frames, "UF", "--frame")
        tool = self._frame(of[2], self._known.tools, "UT", "--tool")
        branch, windows = _configuration(config[1])
        flange = frame @ frames.of_wpr(values[:3], values[3:]) @ inverse_poses(tool)
        return (
            replace(target, flange=flange, tool=tool, branch=branch, windows=windows, notes=beside),
            replace(place, frame=frame),
        )

    def _frame(self, number: str, known: Mapping[str, Array], what: str, option: str) -> Array:
        if number.lower() in known:
            return known[number.lower()]
        if number == "0":
            return np.eye(4)
        raise ValueError(f"its {what} {number} is not in the program: give {option} {number}=x,y,z,w,p,r")

    def _first_group(self, match: re.Match[str]) -> tuple[int, int]:
        """Return the span of the values of group 1; a body without groups is group 1."""
        begin, end = match.span("body")
        groups = list(_GROUP.finditer(self.text, begin, end))
        if not groups:
            return begin, end
        for group, after in zip(groups, [*(g.start() for g in groups[1:]), end], strict=True):
            if group[1] == "1":
                return group.end(), after
        return end, end

    def _used_oddly(self, statements: Sequence[tuple[int, str]]) -> dict[int, str]:
        """Return positions that a motion does not drive to as written.

        The number of the position maps to the reason, as a sentence part.
        """
        out: dict[int, str] = {}
        for at, statement in statements:
            motion = _MOTION.match(statement)
            left = "" if motion is None else _PLAIN.sub(" ", statement[motion.end() :])
            word = re.search(r"[A-Za-z_]\w*+", left)
            why = f"is also used in line {self._lines.at(at)}, which is not read here"
            if motion is not None and word is None:
                begin = way.start() if (way := _ON_ITS_WAY.search(statement)) else len(statement)
                for use in _USE.finditer(statement, begin):
                    out.setdefault(int(use[1]), why)
                continue
            if word is not None:
                why = f"has a motion with '{word[0]}' (line {self._lines.at(at)}), with which it is not read here"
            if _DISTANCE.search(left):
                why = f"is a distance, not a place: used with INC (line {self._lines.at(at)})"
            for use in _USE.finditer(statement):
                out.setdefault(int(use[1]), why)
            if _INDIRECT.search(statement):  # a register says which: it may be any
                self._any_odd = f"a register may name it in line {self._lines.at(at)}: what it names {why}"
        return out

    def _refuse_leftovers(self, begin: int, end: int, found: int) -> None:
        heads = list(re.finditer(r"\bP\[", self.text[begin:end]))
        if len(heads) != found:
            whole = {m.start() for m in _POSITION.finditer(self.text, begin, end)}
            odd = next(begin + m.start() for m in heads if begin + m.start() not in whole)
            raise DataError(
                "a position is not written as P[n]{ ... };",
                do="Correct it, or list the program again.",
                file=self._file,
                line=self._lines.at(odd),
            )


def _statements(text: str, begin: int, end: int) -> list[tuple[int, str]]:
    """Return position and code of every instruction of a part.

    Remarks, and instructions that are remarked out, are left out.
    """
    found = ((m.start("code"), m["code"]) for m in _STATEMENT.finditer(text, begin, end))
    return [(at, code) for at, code in found if not code.lstrip().startswith(("!", "//", "--"))]


def _configuration(text: str) -> tuple[str, dict[int, Window]]:
    """Return branch and ranges of J1, J4, J6, rad, of a CONFIG.

    Raises
    ------
    ValueError
        The CONFIG is not understood.
    """
    letters, *turns = text.split(",")
    words = []
    for choices in _LETTERS:
        chosen = [choices[letter] for letter in letters.split() if letter in choices]
        if len(chosen) != 1:
            raise ValueError(f"its CONFIG '{text.strip()}' does not say {' from '.join(choices.values())}")
        words.append(chosen[0])
    try:
        counted = [int(turn) for turn in turns]
    except ValueError as error:
        raise ValueError(f"its CONFIG '{text.strip()}' has a turn that is not a number") from error
    if len(counted) != len(_TURNED) or any(abs(turn) > _MOST_TURNS for turn in counted):
        raise ValueError(f"its CONFIG '{text.strip()}' does not have three turns")
    half = 180.0 * DEG
    return "/".join(words), {
        joint: (2.0 * half * turn - half, 2.0 * half * turn + half)
        for joint, turn in zip(_TURNED, counted, strict=True)
    }
