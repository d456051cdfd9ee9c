"""URScript: waypoints of movej, movel, movep, movec, as joint angles or poses.

Waypoints are in place or by name.

    q1 = [0.1, -1.57, 1.2, 0.0, 1.57, 0.0]        joint angles, rad; d2r(...) as well
    movel(p[0.4, -0.2, 0.3, 0.0, 3.14, 0.0])      pose of the tool in the base, m and rotation vector, rad

A pose does not state the posture of the arm. The controller takes the solution nearest to its current posture.
This reader takes the one nearest to the waypoint before. The tool is that of `set_tcp`, or of the command line.
The source is the maker's script manual, module motion.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from calib.array import Array
from calib.compensate import inverse_poses
from calib.errors import DataError
from service.programs import frames
from service.programs.frames import UNNAMED, KnownFrames
from service.programs.program import NewTarget, ProgramTarget, beside, rules
from service.programs.syntax import Node, SyntaxUnknown, brackets, lexer, literal, split
from service.programs.text import Edit, Lines, decimal

PLACES = 8  # m and rad
METRE = 1000.0

tokens_of = lexer("#", "\"'")

_MOTIONS = {"movej": 1, "movel": 1, "movep": 1, "movec": 2}  # how many waypoints
_RULES = rules(
    drives=r"^(?:move|servo|speed|optimove|direct_torque|mc_run)[a-z_]*$",
    displaces=r"^(?:path_offset_\w+|track_conveyor_\w+|force_mode|position_deviation_\w+)$",
    loads=r"^set_(?:target_)?payload\w*$",
)
_TOOL = "set_tcp"
_BRANCHES = ("def", "thread", "if", "elif", "else", "while", "for", "end", "run")
# What moves the arm to a posture that is not read: a pose behind it would be reached from there.
_ELSEWHERE = re.compile(r"servoj|speedj|optimovej|(?:freedrive|teach|direct_torque|mc_run)\w*+")
_LONGEST_VALUE = 1_000  # words of a value that can be a waypoint


class UrScript:
    """A URScript program.

    Raises
    ------
    DataError
        A bracket or a string is not closed.
    """

    def __init__(self, text: str, file: str, world: Array, known: KnownFrames) -> None:
        self.text = text
        self._file, self._world, self._lines = file, world, Lines(text, file)
        self._tokens = tokens_of(text, self._lines, file)
        self._brackets = brackets(self._tokens)
        self._values = self._assigned()
        self._tool: Array | None = known.tools.get(UNNAMED)
        self._seen: dict[str, ProgramTarget] = {}
        self._two_tools: set[str] = set()
        self._plain: set[int] = set()  # where a named waypoint stands in a motion that is read
        self._no_tool = "no set_tcp comes before it, so its tool is not known: give --tool"
        self._elsewhere = ""
        found: list[tuple[ProgramTarget, Node | None]] = []
        own = {after.text for token, after in pairwise(self._tokens) if token.text in ("def", "thread")}
        several = self._tools_set() > 1
        done = 0  # the content of a motion's brackets is not read again
        for i, token in enumerate(self._tokens[:-1]):
            calls = self._tokens[i + 1].text == "("
            if i < done or token.kind != "name":
                continue
            if several and (token.text in _BRANCHES or token.text in own):
                self._tool = None
                self._no_tool = (
                    "which tool it is driven with depends on the way that the program takes: write set_tcp in the "
                    "lines before its motion"
                )
            if found and (
                token.text in ("def", "thread", *own) or (calls and _ELSEWHERE.fullmatch(token.text))
            ):
                self._elsewhere = f"'{token.text}' (line {self._lines.at(token.start)})"
            if calls and token.text == _TOOL:
                self._tool, done = self._set_tcp(i), self._closing(i + 1)
            elif calls and token.text in _MOTIONS:
                found += self._motion(i, _MOTIONS[token.text])
                done = self._closing(i + 1)
        calls = [
            (token.start, token.text)
            for token, after in pairwise(self._tokens)
            if token.kind == "name" and after.text == "(" and token.text not in {*_MOTIONS, *own}
        ]
        shared = self._read_elsewhere({target.name for target, _ in found}) | dict.fromkeys(
            self._two_tools, "it is used with two tools: one correction cannot serve both"
        )
        found = [
            (replace(target, refused=shared[target.name]), node)
            if target.flange is not None and target.name in shared
            else (target, node)
            for target, node in found
        ]
        found = beside(found, calls, _RULES, self._lines, None)
        self.targets: Sequence[ProgramTarget] = tuple(target for target, _ in found)
        self._nodes = tuple(node for _, node in found)

    def edits(self, index: int, driven: NewTarget) -> list[Edit]:
        """Return edits of the numbers that differ."""
        target, node = self.targets[index], self._nodes[index]
        if node is None:
            return []
        if target.joints is not None:
            return _set(node, driven.joints)
        pose = inverse_poses(self._world) @ driven.flange @ target.tool
        vector = frames.rotation_vector(pose, [_number(item) for item in node.items[3:]])
        return _set(node, np.array([*(pose[:3, 3] / METRE), *vector]))

    def _motion(self, i: int, count: int) -> list[tuple[ProgramTarget, Node | None]]:
        parts = split(self._tokens[i + 2 : self._closing(i + 1)], ",")
        out = []
        for part in parts[:count]:
            at = part[0].start if part else self._tokens[i].start
            line = self._lines.at(at)
            try:
                node = literal(part)
                self._plain.add(node.start)
                name = node.text if node.kind == "name" else f"line {line}"
                out += self._waypoint(name, line, node)
            except SyntaxUnknown as unknown:
                why = f"is computed while the program runs: {unknown}"
                out.append((ProgramTarget(f"line {line}", line, refused=why), None))
            if self._tokens[i].text == "movej" and out and out[-1][0].refused:
                self._elsewhere = f"'movej' (line {line})"
        return out

    def _tools_set(self) -> int:
        """Count the different tools of the program."""
        words = {
            tuple(token.text for token in self._tokens[i + 2 : self._closing(i + 1)])
            for i, (token, after) in enumerate(pairwise(self._tokens))
            if token.text == _TOOL and after.text == "("
        }
        return len(words) + (self._tool is not None)

    def _read_elsewhere(self, names: set[str]) -> dict[str, str]:
        """Return the reasons why named waypoints are not corrected.

        Another statement that reads them may drive there with another tool.
        """
        out: dict[str, str] = {}
        for i, token in enumerate(self._tokens):
            after = self._tokens[i + 1].text if i + 1 < len(self._tokens) else ""
            if token.text in names and after != "=" and token.start not in self._plain:
                why = f"it is also used in line {self._lines.at(token.start)}, which is not read here"
                out.setdefault(token.text, why)
        return out

    def _waypoint(self, name: str, line: int, node: Node) -> list[tuple[ProgramTarget, Node | None]]:
        if node.kind == "name":
            values = self._values.get(node.text, [])
            if len(values) != 1 or values[0] is None:
                why = "is computed while the program runs" if values else "has no value in this program"
                return [(ProgramTarget(name, line, refused=why), None)]
            node = values[0]
            line = self._lines.at(node.start)
        target = self._read(ProgramTarget(name, line), node)
        if name in self._seen:  # a named waypoint used again: the same text, already a target
            before = self._seen[name]
            same = before.flange is None or np.allclose(before.tool, target.tool)
            if not same:
                self._two_tools.add(name)
            return []
        if not name.startswith("line "):
            self._seen[name] = target
        return [(target, node if not target.refused else None)]

    def _read(self, target: ProgramTarget, node: Node) -> ProgramTarget:
        try:
            if node.kind != "list" or node.text not in ("", "p") or len(node.items) != 6:
                raise ValueError("is neither six joint angles nor a pose")
            values = [_number(item) for item in node.items]
            if node.text == "":
                self._elsewhere = ""
                return replace(target, joints=frames.joint_angles(values))
            if self._tool is None:
                raise ValueError(self._no_tool)
            if self._elsewhere:
                raise ValueError(
                    f"the posture before it is not known: {self._elsewhere} is not followed here"
                )
            pose = frames.of_vector([METRE * v for v in values[:3]], values[3:])
        except SyntaxUnknown as unknown:
            return replace(target, refused=f"is computed while the program runs: {unknown}")
        except ValueError as error:
            return replace(target, refused=str(error))
        return replace(target, flange=self._world @ pose @ inverse_poses(self._tool), tool=self._tool)

    def _set_tcp(self, i: int) -> Array | None:
        """Return the tool that is set; None when it is not a plain pose."""
        try:
            node = literal(split(self._tokens[i + 2 : self._closing(i + 1)], ",")[0])
            if node.kind == "name":
                (found,) = self._values.get(node.text, [None])
                if found is None:
                    return None
                node = found
            if node.text != "p" or len(node.items) != 6:
                return None
            values = [_number(item) for item in node.items]
            return frames.of_vector([METRE * v for v in values[:3]], values[3:])
        except (SyntaxUnknown, ValueError):
            return None

    def _assigned(self) -> dict[str, list[Node | None]]:
        """Return every value that a name is given.

        It is None if the value is computed or an element of it is changed.
        """
        out: dict[str, list[Node | None]] = {}
        ends = self._statement_ends()
        for i, token in enumerate(self._tokens[:-1]):
            if token.kind != "name":
                continue
            at = i + 1
            element = self._tokens[at].text == "["
            if element:
                at = self._closing(at) + 1
            if at + 1 >= len(self._tokens) or self._tokens[at].text != "=":
                continue
            # In brackets `name =` names an argument, as in movej(q, a=1.2).
            if self._tokens[at + 1].text == "=" or not ends[i]:
                continue
            value = None if element else self._value(at + 1, ends[at + 1] or at)
            out.setdefault(token.text, []).append(value)
        return out

    def _value(self, at: int, end: int) -> Node | None:
        """Return the literal that fills the rest of its line; none is longer than some numbers."""
        if end - at > _LONGEST_VALUE:
            return None
        try:
            return literal(self._tokens[at:end])
        except SyntaxUnknown:
            return None

    def _statement_ends(self) -> list[int]:
        """Return the index behind the statement of every token; 0 within brackets.

        A statement is one line, or more if brackets continue.
        """
        count = len(self._tokens)
        begins, within, closes = [count], [False] * count, -1
        for i, token in enumerate(self._tokens):
            within[i] = i <= closes
            between = self.text[self._tokens[i - 1].end : token.start] if i else ""
            if not within[i] and ("\n" in between or "\r" in between):
                begins.append(i)
            if not within[i] and token.kind == "sign" and token.text in "([{":
                closes = self._closing(i)
        begins.sort()
        ends, next_one = [0] * count, 0
        for i in range(count):
            next_one += begins[next_one] <= i
            ends[i] = 0 if within[i] else begins[next_one]
        return ends

    def _closing(self, at: int) -> int:
        if at not in self._brackets:
            line = self._lines.at(self._tokens[at].start)
            raise DataError("a bracket is not closed.", do="Close it.", file=self._file, line=line)
        return self._brackets[at]


def _number(node: Node) -> float:
    """Return a number, or d2r of one.

    Raises
    ------
    SyntaxUnknown
        The node is neither.
    """
    if node.kind == "number":
        return node.value
    if node.kind == "call" and node.text == "d2r" and len(node.items) == 1 and node.items[0].kind == "number":
        return math.radians(node.items[0].value)
    raise SyntaxUnknown(node.start, f"'{node.text}' is there where a number is needed")


def _set(node: Node, values: Array) -> list[Edit]:
    return [
        Edit(item.start, item.end, decimal(float(value), PLACES))
        for item, value in zip(node.items, values, strict=True)
        if abs(_number(item) - value) > 0.5 * 10.0**-PLACES
    ]
