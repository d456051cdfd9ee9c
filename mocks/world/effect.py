"""A hidden effect: a label of the contract, a law, its amplitudes and its shape constants."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from mocks.world.robots import Robot

Values = Mapping[str, float]

Stage = Literal["loads", "arm", "point", "instrument"]
"""When a law acts: before the torques are taken, on the arm, on the true point, on what the tracker sees."""


@dataclass(frozen=True)
class Effect:
    """One hidden effect.

    `act(target, values)` changes an Arm (stages "loads" and "arm") or a Sight (stages "point" and
    "instrument") in place. `amplitudes` are linear: all of them zero means the effect is absent.
    `constants` are shape parameters (order, reading of a step, time constant) and are never scaled.
    `units` gives the unit of every amplitude and constant; `shape` is "textbook" or a departure's name.
    """

    label: str
    stage: Stage
    act: Callable[[Any, Values], None]
    amplitudes: dict[str, float]
    units: dict[str, str]
    constants: dict[str, float] = field(default_factory=dict)
    shape: str = "textbook"

    @property
    def values(self) -> dict[str, float]:
        """Amplitudes and constants together."""
        return {**self.amplitudes, **self.constants}

    def times(self, factor: float) -> Effect:
        """Return the same effect with all amplitudes multiplied by `factor`."""
        return replace(self, amplitudes={name: factor * v for name, v in self.amplitudes.items()})

    def with_values(self, **values: float) -> Effect:
        """Return the same effect with some amplitudes or constants set, in the units of `units`."""
        unknown = set(values) - set(self.values)
        if unknown:
            raise ValueError(f"{self.label} has no parameter {sorted(unknown)}, only {sorted(self.values)}")
        return replace(
            self,
            amplitudes={k: values.get(k, v) for k, v in self.amplitudes.items()},
            constants={k: values.get(k, v) for k, v in self.constants.items()},
        )

    def truth(self) -> dict[str, Any]:
        """Return the effect as plain data: label, parameters with units, shape."""
        parameters = {n: {"value": v, "unit": self.units[n]} for n, v in self.values.items()}
        return {"label": self.label, "parameters": parameters, "shape": self.shape}


def joint_number(text: str) -> int:
    """Return the number of a joint from its name, such as 6 from "j6".

    Raises
    ------
    ValueError
        The text is not the name of a joint.
    """
    if text[:1] != "j" or not text[1:].isdecimal() or text[1] == "0":
        raise ValueError(f"{text!r} is not a joint such as j1")
    return int(text[1:])


def number_of(robot: Robot, part: str) -> str:
    """Return a part of a label with every joint as its number in the table of links.

    On an arm on a track, j1 is j2 and e1 is j1.

    Raises
    ------
    ValueError
        The robot has no such joint.
    """
    names = part.split("-") if part[:1] in "je" and part[1:2].isdecimal() else ()
    for name in names:
        if name not in robot.names:
            raise ValueError(f"{name!r} is not one of the joints {', '.join(robot.names)} of {robot.name}")
    return "-".join(f"j{robot.names.index(name) + 1}" for name in names) or part
