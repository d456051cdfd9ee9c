"""Yaskawa jobs (.jbi): the positions of the robot, C00000 and following, in pulses.

    ///TOOL 0
    ///POSTYPE PULSE
    ///PULSE
    C00000=0,-12034,5230,0,-40110,87

One pulse is one step of a motor, counted as the controller counts the joint. The number of pulses per degree is
a parameter of the controller. `--pulses` gives one number per axis, negative if the joint of the model turns
the other way. Positions in a frame (BASE, ROBOT, USER) are refused by name, because the meaning of RCONF for
the postures was not confirmed on a controller. Base and station axes (BC, EC) are kept. Sources are
descriptions of the format and public jobs. It was not tried on a controller.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from calib.errors import DataError
from calib.units import DEG
from service.programs import frames
from service.programs.frames import KnownFrames
from service.programs.program import TWICE, NewTarget, ProgramTarget, beside, rules
from service.programs.text import Edit, Lines, Number

_LINE = re.compile(r"[^\r\n]++")
_POSITION = re.compile(r"(?P<name>C\d{3,6}+)\s*+=(?P<values>.*+)")
_TYPE = re.compile(r"///POSTYPE\s++(\w++)")
# A parallel shift moves taught positions as well, in any kind of storage.
_RULES = rules(
    drives=r"^\s*+\+?(?:SY?|I)?+MOV[A-Z]?+\s++L?+(?:P|BP|EX|D)\w*+",
    shifts=r"^\s*+(?:SFTON|SYSTART|COMARCON)\b",
    loads=r"^\s*+(?:SETTOOL|TOOLLD)\b",
)
_MOTION = re.compile(r"\s*+\+?+S?+MOV[JLCS]\b")
_USE = re.compile(r"(?<![A-Z0-9])C\d{3,6}+")
_PULSES = re.compile(r"[-+]?\d{1,9}+")


class YaskawaJob:
    """A .jbi job.

    Raises
    ------
    DataError
        The text is no job.
    """

    def __init__(self, text: str, file: str, known: KnownFrames) -> None:
        self.text = text
        self._lines = Lines(text, file)
        if re.match(r"\ufeff?/JOB\b", text) is None or re.search(r"^//POS\b", text, re.MULTILINE) is None:
            raise DataError(
                "is not a Yaskawa job: /JOB and //POS are missing.",
                do="Give a .jbi file as the controller saves it.",
                file=file,
                line=1,
            )
        self._per_deg = np.array(known.pulses_per_deg)
        statements = [(m.start(), m.group()) for m in _LINE.finditer(text)]
        begin = text.find("//INST")
        self._odd = {
            name: f"is also used in line {self._lines.at(at)}, which is not read here"
            for at, line in reversed(statements)
            if at > begin >= 0 and not _MOTION.match(line) and not line.lstrip().startswith("'")
            for name in _USE.findall(line)
        }
        names = Counter(m["name"] for _, line in statements if (m := _POSITION.match(line)) is not None)
        self._odd |= {name: TWICE for name, count in names.items() if count > 1}
        found = beside(list(self._read()), statements, _RULES, self._lines, [])
        self.targets: Sequence[ProgramTarget] = tuple(target for target, _ in found)
        self._pulses = tuple(pulses for _, pulses in found)

    def edits(self, index: int, driven: NewTarget) -> list[Edit]:
        """Return edits of the pulses that differ."""
        wanted = np.round(np.degrees(driven.joints) * self._per_deg)
        return [
            Edit(slot.start, slot.end, str(int(count)))
            for slot, count in zip(
                self._pulses[index], wanted, strict=False
            )  # robots of fewer axes write as many
            if int(count) != slot.value
        ]

    def _read(self) -> Iterator[tuple[ProgramTarget, list[Number]]]:
        kind, within = "", False
        for line in _LINE.finditer(self.text):
            words = line.group().strip()
            if words.startswith("//") and not words.startswith("///"):
                within = words.upper().startswith("//POS")
            if (match := _TYPE.match(words)) is not None:
                kind = match[1].upper()
            position = _POSITION.match(line.group())
            if within and position is not None:
                target = ProgramTarget(position["name"], self._lines.at(line.start()))
                yield self._position(
                    target, kind, position["values"], line.start() + position.start("values")
                )

    def _position(
        self, target: ProgramTarget, kind: str, values: str, at: int
    ) -> tuple[ProgramTarget, list[Number]]:
        if target.name in self._odd:
            return replace(target, refused=self._odd[target.name]), []
        if kind != "PULSE":
            why = f"it is in the frame {kind or 'of nobody knows what'}, and only pulses are read"
            return replace(target, refused=why), []
        if not len(self._per_deg):
            return replace(
                target, refused="it is in pulses: give --pulses, how many make a degree of each axis"
            ), []
        pulses, begin = [], 0
        for part in values.split(","):
            number = part.strip()
            if not _PULSES.fullmatch(number):
                return replace(target, refused=f"'{number[:20]}' is no number of pulses"), []
            start = at + begin + part.index(number)
            pulses.append(Number(start, start + len(number), int(number)))
            begin += len(part) + 1
        if len(pulses) != len(self._per_deg):
            return replace(target, refused=f"it has {len(pulses)} axes, --pulses {len(self._per_deg)}"), []
        try:
            degrees = np.array([slot.value for slot in pulses]) / self._per_deg
            return replace(target, joints=frames.joint_angles(degrees * DEG)), pulses
        except ValueError as error:
            return replace(target, refused=str(error)), []
