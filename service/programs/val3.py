"""Staubli VAL3 data (.dtx): joint positions of `type="jointRx"`.

Points are refused by name.

    <Data name="jHome" access="private" xsi:type="array" type="jointRx" size="1">
      <Value key="0" j1="0" j2="-12.5" j3="90" j4="0" j5="60" j6="0" />
    </Data>

Angles are in deg. Joints that are not written count as 0, and get a number only by hand. A `pointRx` counts in
a frame with a tool that the program (.pgx) names, and its shoulder is righty or lefty, which the robot file
does not know. The file is not read as general XML: elements of other kinds, and everything between, stay as
text. Sources are public applications. It was not tried on a controller.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.errors import DataError
from calib.units import DEG
from service.programs import frames
from service.programs.program import TWICE, NewTarget, ProgramTarget
from service.programs.text import Edit, Lines, decimal

PLACES = 6
_TAG = re.compile(r"<(?P<name>/?+[A-Za-z]\w*+)(?P<rest>[^<>]*+)>")
_ATTRIBUTE = re.compile(r"(?<![\w:])(?P<name>[A-Za-z][\w:]*+)\s*+=\s*+\"(?P<value>[^\"<>]*+)\"")
_NUMBER = re.compile(r"\s*+[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d{1,3}+)?\s*+")
_AXES = ("j1", "j2", "j3", "j4", "j5", "j6")
_POINT = ("pointrx",)


@dataclass(frozen=True)
class _Number:
    start: int
    end: int
    value: float


class Val3Data:
    """A .dtx file.

    Raises
    ------
    DataError
        The text is no .dtx file, or declares entities.
    """

    def __init__(self, text: str, file: str) -> None:
        self.text = text
        self._lines = Lines(text, file)
        if re.search(r"<Database\b", text) is None or "<!ENTITY" in text or "<![CDATA[" in text:
            raise DataError(
                "is not the data of a VAL3 application.",
                do="Give a .dtx file as it was saved.",
                file=file,
                line=1,
            )
        self._tags = self._without_comments(file)
        found = list(self._read())
        names = Counter(target.name for target, _ in found)
        found = [
            (replace(target, joints=None, refused=target.refused or TWICE), {})
            if names[target.name] > 1
            else (target, numbers)
            for target, numbers in found
        ]
        self.targets: Sequence[ProgramTarget] = tuple(target for target, _ in found)
        self._numbers = tuple(numbers for _, numbers in found)

    def edits(self, index: int, driven: NewTarget) -> list[Edit]:
        """Return edits of the angles that differ."""
        values: dict[str, float] = dict(zip(_AXES, np.degrees(driven.joints), strict=True))
        return [
            Edit(slot.start, slot.end, decimal(float(values[name]), PLACES))
            for name, slot in self._numbers[index].items()
            if abs(slot.value - values[name]) > 0.5 * 10.0**-PLACES
        ]

    def _without_comments(self, file: str) -> str:
        """Return the text with blanks in place of comments.

        Raises
        ------
        DataError
            A comment is not closed.
        """
        parts, at = [], 0
        while (begin := self.text.find("<!--", at)) >= 0:
            end = self.text.find("-->", begin)
            if end < 0:
                line = self._lines.at(begin)
                raise DataError("a comment is not closed.", do="Close it.", file=file, line=line)
            parts += [self.text[at:begin], " " * (end + 3 - begin)]
            at = end + 3
        return "".join([*parts, self.text[at:]])

    def _read(self) -> Iterator[tuple[ProgramTarget, Mapping[str, _Number]]]:
        name, kind = "", ""
        for tag in _TAG.finditer(self._tags):
            if tag["name"] not in ("Data", "/Data", "Value"):
                continue
            attributes = {m["name"].lower(): m for m in _ATTRIBUTE.finditer(tag["rest"])}
            if tag["name"] != "Value":
                opens = tag["name"] == "Data" and not tag["rest"].endswith("/")
                name = attributes["name"]["value"] if opens and "name" in attributes else ""
                kind = attributes["type"]["value"].lower() if opens and "type" in attributes else ""
                continue
            if kind not in ("jointrx", *_POINT) or not name:
                continue
            key = attributes["key"]["value"] if "key" in attributes else "0"
            target = ProgramTarget(f"{name}[{key}]", self._lines.at(tag.start()))
            if kind in _POINT:
                why = "it is a point: its tool is named in the .pgx, and righty or lefty is not known of the robot"
                yield replace(target, refused=why), {}
            else:
                yield self._joints(target, attributes, tag.start("rest"))

    def _joints(
        self, target: ProgramTarget, attributes: Mapping[str, re.Match[str]], at: int
    ) -> tuple[ProgramTarget, Mapping[str, _Number]]:
        if missing := [axis for axis in _AXES if axis not in attributes]:
            return replace(
                target, refused=f"it has no {missing[0]} that could be corrected: write it as 0"
            ), {}
        numbers: dict[str, _Number] = {}
        for axis in _AXES:
            match = attributes[axis]
            if not _NUMBER.fullmatch(match["value"]):
                return replace(target, refused=f"its {axis} is '{match['value'][:20]}', no number"), {}
            numbers[axis] = _Number(at + match.start("value"), at + match.end("value"), float(match["value"]))
        try:
            degrees = np.array([numbers[axis].value for axis in _AXES])
            return replace(target, joints=frames.joint_angles(degrees * DEG)), numbers
        except ValueError as error:
            return replace(target, refused=str(error)), {}
