"""RAPID modules (.mod): robtargets and jointtargets, named, in arrays, or in the motion.

    robtarget = [[x, y, z], [q1..q4], [cf1, cf4, cf6, cfx], [six external axes]]
    jointtarget = [[six angles, deg], [six external axes]]

A robtarget is a pose of the tool in the work object, mm and scalar-first quaternion. cfx numbers the branch. It is in
front of or behind axis 1, in front of or behind the lower arm, with axis 5 positive or negative. cf1, cf4, cf6 are
quarter turns of joints 1, 4, 6. 9E9 means an axis that is not used. The source is the maker's RAPID reference, data
types.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import floor

import numpy as np

from calib.arm import BRANCHES
from calib.array import Array
from calib.compensate import inverse_poses
from calib.units import DEG
from service.programs import frames
from service.programs.frames import UNNAMED, KnownFrames
from service.programs.program import NewTarget, ProgramTarget, Window, beside, rules
from service.programs.rapid_module import Declaration, Module, TargetUse
from service.programs.syntax import Node, SyntaxUnknown, literal
from service.programs.text import Edit, Lines, decimal

MM_PLACES, QUATERNION_PLACES, DEG_PLACES = 5, 9, 6
UNUSED = 1e8  # external axes from here on are not used; written 9E9
QUARTER_EDGE = 0.5 * DEG  # an angle this close to a quarter turn may have been counted on either side of it
ROUNDING = 1e-6 * DEG
_MOST_QUARTERS = 1000
# Process packages name their motions after the process and the path: SpotL, PaintC, DispJ. What else takes a speed, a
# zone or a target in place is a motion as well.
_RULES = rules(
    drives=r"^(?!MoveExtJ\b)\w++(?:(?=.* , (?:v\d++|vmax|z\d++|fine)(?: [,\\]|$))"
    r"|(?=.* \[ \[[^][]*+\] , \[[^][]*+\] , \[[^][]*+\] , \[))"
    r"|^(?:Move|Trigg|Search|Arc|Spot|SpotM|Paint|Disp|Cap|Las|Glue|Nut|Stud|Contact|FCPress)\w*+(?<=[LJC])(?= |$)"
    r"|^(?:EGM(?:MoveL|MoveC|RunJoint|RunPose)|IndAMove|IndRMove|IndDMove|IndCMove|MovePnP)\b",
    displaces=r"^(?:PDispOn|PDispSet|EOffsOn|EOffsSet|CorrCon|CorrWrite)\b|^\\Corr$",
    loads=r"^(?:GripLoad|SetSysData|MechUnitLoad)\b|^\\TLoad$",
    turns=r"^Conf[JL] \\ Off\b",
)
_QUARTERED = (0, 3, 5)  # joints 1, 4, 6


class RapidProgram:
    """A RAPID module.

    Raises
    ------
    DataError
        The text is no module.
    """

    def __init__(self, text: str, file: str, world: Array, known: KnownFrames) -> None:
        self.text = text
        self._module = Module(text, file)
        self._world, self._known = world, known
        self._handed = {  # what an instruction gets that may change it
            word: at
            for at, code in reversed(self._module.instructions)
            if not any(rule.pattern.search(code) for rule in _RULES)
            for word in code.lower().split()
        }
        found = [*self._declared(), *self._in_place()]
        found.sort(key=lambda pair: pair[1].at)
        found = beside(found, self._module.instructions, _RULES, Lines(text, file), _RapidPlace(0))
        self.targets: Sequence[ProgramTarget] = tuple(target for target, _ in found)
        self._places = tuple(place for _, place in found)

    def edits(self, index: int, driven: NewTarget) -> list[Edit]:
        """Return edits of the numbers that differ."""
        place, target = self._places[index], self.targets[index]
        if place.node is None:
            return []
        if target.joints is not None:
            return self._set(self._module.items(place.node, 2)[0], np.degrees(driven.joints), DEG_PLACES)
        trans, rot, conf, _ = self._module.items(place.node, 4)
        pose = inverse_poses(place.frame) @ driven.flange @ target.tool
        quaternion = frames.quaternion(pose, self._module.numbers(rot, 4))
        *quarters, branch = self._module.numbers(conf, 4)
        turned = [_quarter(driven.joints[k], old) for k, old in zip(_QUARTERED, quarters, strict=True)]
        return [
            *self._set(trans, pose[:3, 3], MM_PLACES),
            *self._set(rot, quaternion, QUATERNION_PLACES),
            *self._set(conf, [*turned, branch], 0),
        ]

    def _set(self, node: Node, values: Sequence[float] | Array, places: int) -> list[Edit]:
        half = 0.5 * 10.0**-places
        old = self._module.numbers(node, len(values))
        differs = [abs(a - b) > half for a, b in zip(old, values, strict=True)]
        if node.kind != "list":  # a named constant, which others may use as well
            numbers = ",".join(decimal(v, places) for v in values)
            return [Edit(node.start, node.end, f"[{numbers}]")] if any(differs) else []
        return [
            Edit(item.start, item.end, decimal(value, places))
            for item, value, other in zip(node.items, values, differs, strict=True)
            if other
        ]

    def _declared(self) -> list[tuple[ProgramTarget, _RapidPlace]]:
        out = []
        uses: dict[str, list[TargetUse]] = {}
        for use in self._module.uses:
            uses.setdefault(use.name.lower(), []).append(use)
        for name, declarations in self._module.declarations.items():
            for declaration in declarations:
                if declaration.type in ("robtarget", "jointtarget"):
                    twice = len(declarations) > 1
                    out += self._of_declaration(declaration, uses.get(name, []), twice=twice)
        return out

    def _of_declaration(
        self, declaration: Declaration, uses: list[TargetUse], *, twice: bool
    ) -> list[tuple[ProgramTarget, _RapidPlace]]:
        line = self._module.line(declaration.at)
        nowhere = _RapidPlace(declaration.at)

        def whole(why: str) -> list[tuple[ProgramTarget, _RapidPlace]]:
            return [(ProgramTarget(declaration.name, line, refused=why), nowhere)]

        if not declaration.value:
            return whole("has no value in this module") if uses else []
        if twice:
            return whole("is declared more than once")
        foreign = self._module.foreign.get(declaration.name.lower())
        if foreign is not None:
            return whole(f"is used by {foreign[1]} (line {foreign[0]}) as well, which is not read here")
        assigned = self._module.assigned.get(declaration.name.lower())
        if assigned is not None:
            return whole(f"gets another value while the program runs (line {assigned})")
        try:
            elements = _elements(self._module, literal(declaration.value), declaration.dimensions)
        except SyntaxUnknown as unknown:
            return whole(f"is not a plain value: {unknown}")
        out = []
        for indices, node in elements:
            name = declaration.name + ("{" + ",".join(map(str, indices)) + "}" if indices else "")
            target = ProgramTarget(name, self._module.line(node.start))
            if node.kind == "name":
                out.append((replace(target, refused=f"is a copy of '{node.text}'"), _RapidPlace(node.start)))
                continue
            if any(not use.plain for use in uses):
                target = replace(
                    target, notes=("points that Offs or RelTool take from it are moved along with it",)
                )
            out.append(self._read(target, node, uses, joints=declaration.type == "jointtarget"))
        return out

    def _in_place(self) -> list[tuple[ProgramTarget, _RapidPlace]]:
        """Return targets written into motions, and those that are not in this module."""
        out, missing = [], set[str]()
        for use in self._module.uses:
            line = self._module.line(use.at)
            if use.unknown:
                why = f"is not a plain target: {use.unknown}"
                out.append((ProgramTarget(f"line {line}", line, refused=why), _RapidPlace(use.at)))
            elif use.target is not None:
                out.append(
                    self._read(ProgramTarget(f"line {line}", line), use.target, [use], joints=use.joints)
                )
            elif use.name.lower() not in self._module.declarations and use.name.lower() not in missing:
                missing.add(use.name.lower())
                why = "is not declared in this module"
                out.append((ProgramTarget(use.name, line, refused=why), _RapidPlace(use.at)))
        return out

    def _read(
        self, target: ProgramTarget, node: Node, uses: list[TargetUse], *, joints: bool
    ) -> tuple[ProgramTarget, _RapidPlace]:
        place = _RapidPlace(node.start, node)
        try:
            if joints:
                degrees = self._module.numbers(self._module.items(node, 2)[0], 6)
                return replace(target, joints=frames.joint_angles(np.array(degrees) * DEG)), place
            trans, rot, conf, external = self._module.items(node, 4)
            pose = frames.of_quaternion(self._module.numbers(trans, 3), self._module.numbers(rot, 4))
            cf1, cf4, cf6, cfx = self._module.numbers(conf, 4)
            if cfx not in range(len(BRANCHES)):
                raise ValueError(f"its configuration number is {cfx:g}, not 0 to 7")
            if any(abs(quarter) > _MOST_QUARTERS for quarter in (cf1, cf4, cf6)):
                raise ValueError(f"its quarter turns are beyond {_MOST_QUARTERS}")
            used = any(abs(value) < UNUSED for value in self._module.numbers(external, 6))
            beside = self._known.note_external(used=used)
            tool, frame = self._tool_and_frame(uses)
        except SyntaxUnknown as unknown:
            return replace(target, refused=f"is not a plain value: {unknown}"), place
        except ValueError as error:
            return replace(target, refused=str(error)), place
        return (
            replace(
                target,
                flange=frame @ pose @ inverse_poses(tool),
                tool=tool,
                branch=BRANCHES[int(cfx)],
                windows={k: _window(cf) for k, cf in zip(_QUARTERED, (cf1, cf4, cf6), strict=True)},
                turns_written=True,
                notes=(*target.notes, *beside),
            ),
            replace(place, frame=frame),
        )

    def _tool_and_frame(self, uses: list[TargetUse]) -> tuple[Array, Array]:
        """Return the tool on the flange and the work object in the base frame.

        Raises
        ------
        ValueError
            They are not known.
        """
        pairs = {(use.tool.lower(), use.work_object.lower()) for use in uses} or {(UNNAMED, UNNAMED)}
        found = [(self._tool(tool), self._world @ self._frame(frame)) for tool, frame in sorted(pairs)]
        if any(not np.allclose(np.array(f), np.array(found[0]), atol=1e-9) for f in found[1:]):
            names = " and ".join("/".join(pair) for pair in sorted(pairs))
            raise ValueError(f"it is used with {names}: one correction cannot serve both")
        return found[0]

    def _tool(self, name: str) -> Array:
        if name == "tool0":
            return np.eye(4)
        if name in self._known.tools:
            return self._known.tools[name]
        if name == UNNAMED:
            raise ValueError("no motion of this module uses it, so its tool is not known: give --tool")
        held, frame, _ = self._record(name, "tooldata", 3, "--tool")
        if held.text.lower() != "true":
            raise ValueError(f"its tool '{name}' is fixed in the cell")
        return self._pose(frame)

    def _frame(self, name: str) -> Array:
        if name in ("wobj0", UNNAMED) and name not in self._known.frames:
            return np.eye(4)
        if name in self._known.frames:
            return self._known.frames[name]
        held, fixed, _, user, own = self._record(name, "wobjdata", 5, "--frame")
        if held.text.lower() != "false" or fixed.text.lower() != "true":
            raise ValueError(f"its work object '{name}' is moved by the robot or another machine")
        return self._pose(user) @ self._pose(own)

    def _record(self, name: str, kind: str, count: int, option: str) -> tuple[Node, ...]:
        found = self._module.declarations.get(name, [])
        if len(found) != 1 or found[0].type != kind or not found[0].value:
            raise ValueError(f"its '{name}' is not declared in this module: give {option} {name}=x,y,z,w,p,r")
        if name in self._module.assigned:
            raise ValueError(f"its '{name}' gets another value while the program runs")
        if name in self._handed:
            line = self._module.line(self._handed[name])
            raise ValueError(f"its '{name}' may get another value in line {line}, which is not read here")
        return self._module.items(literal(found[0].value), count)

    def _pose(self, node: Node) -> Array:
        trans, rot = self._module.items(node, 2)
        return frames.of_quaternion(self._module.numbers(trans, 3), self._module.numbers(rot, 4))


@dataclass(frozen=True)
class _RapidPlace:
    """A target in the text: its position, its value, and the frame of its pose."""

    at: int
    node: Node | None = None
    frame: Array = field(default_factory=lambda: np.eye(4))


def _window(quarter: float, edge: float = QUARTER_EDGE) -> Window:
    return quarter * 90.0 * DEG - edge, (quarter + 1.0) * 90.0 * DEG + edge


def _quarter(angle: float, old: float) -> float:
    """Return the quarter turn in which an angle, rad, is; the old one on its very edge."""
    begin, end = _window(old, ROUNDING)
    return old if begin <= angle <= end else float(floor(angle / (90.0 * DEG)))


def _elements(module: Module, node: Node, dimensions: tuple[int, ...]) -> list[tuple[tuple[int, ...], Node]]:
    """Return the elements of an array with their indices, from 1.

    Without dimensions, it is the value itself.
    """
    if not dimensions:
        return [((), node)]
    nodes: list[Node] = [node]
    for size in dimensions:
        copied = next((each for each in nodes if each.kind == "name"), None)
        if copied is not None:
            raise SyntaxUnknown(copied.start, f"it is a copy of '{copied.text}'")
        nodes = [item for each in nodes for item in module.items(each, size)]
    indices = itertools.product(*(range(1, size + 1) for size in dimensions))
    return list(zip(indices, nodes, strict=True))
