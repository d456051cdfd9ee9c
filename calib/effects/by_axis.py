"""Effects named by axes: on a track, link 2 of the chain is joint 1 of the arm.

Files of the library count joints as links, 1 to N. Of an arm without slides before its joints and without external axes
the two are the same.
"""

from __future__ import annotations

import re
from dataclasses import replace

from calib.arm.robot import Robot
from calib.model.effect import Effect
from calib.scan.fixed import Candidate
from calib.scan.harmonics import Harmonics
from calib.scan.scores import Family
from calib.scan.shapes import Shapes
from calib.scan.steps import Steps

_IN_LABEL = re.compile(r"(?<=[:-])j(\d+)")
_IN_WORDS = re.compile(r"\b([Jj]oint|[Ll]ink|and) (\d+)")


def counts_alike(robot: Robot) -> bool:
    """Whether joint k is link k."""
    return robot.axes == tuple(f"j{k}" for k in range(1, robot.joints + 1))


def by_axis(effect: Effect, robot: Robot) -> Effect:
    """The effect with the name of the axis for the number of its link in label, parameters and meaning."""
    if counts_alike(robot):
        return effect
    label, before = _label(effect.label, robot), f"{effect.label}."

    def renamed(name: str) -> str:
        return f"{label}.{name.removeprefix(before)}" if name.startswith(before) else name

    return replace(
        effect,
        label=label,
        meaning=_IN_WORDS.sub(
            lambda found: f"{found[1]} {robot.axes[int(found[2]) - 1].removeprefix('j')}", effect.meaning
        ),
        parameters=tuple(replace(p, name=renamed(p.name)) for p in effect.parameters),
        terms=tuple(replace(t, parameter=renamed(t.parameter)) for t in effect.terms),
    )


def family_by_axis(family: Family, robot: Robot) -> Family:
    """The family with effects named by their axes."""
    if counts_alike(robot):
        return family
    if isinstance(family, Candidate):
        return Candidate(by_axis(family.effect, robot))
    if isinstance(family, Harmonics | Steps | Shapes):
        make = family.at
        return replace(
            family, label=_label(family.label, robot), at=lambda shape: by_axis(make(shape), robot)
        )
    return family


def _label(label: str, robot: Robot) -> str:
    return _IN_LABEL.sub(lambda found: robot.axes[int(found[1]) - 1], label)
