"""Jobs of a simulated Yaskawa controller: the few instructions of INFORM that they need.

They are `SET`, `ADD` and `MUL` on I and D variables, `GETE`, `JUMP` with one condition, labels, `MOVJ` to a P variable
and comments. D variables have 32 bits, I variables 16, as in the controller: a result beyond them stops the job.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

_WIDTH = {"D": 31, "I": 15}
_PULSES = 8  # of a position variable
_MOVE = re.compile(r"MOVJ P(\d+) VJ=(I\d+|\d+\.\d\d) PL=(\d)")
_JUMP = re.compile(r"JUMP (\*\w+)(?: IF (\w+)(=|<>)(\w+))?")
_GETE = re.compile(r"GETE (D\d+) P(\d+) \((\d)\)")
_SUMS = re.compile(r"(SET|ADD|MUL) ([ID]\d+) (-?\w+)")


class JobError(Exception):
    """An instruction that cannot be carried out; the controller shows an alarm."""


@dataclass
class Variables:
    """Variables of a controller; those never written are 0, a position variable is undefined."""

    numbers: dict[str, int] = field(default_factory=dict)
    positions: dict[int, tuple[int, ...]] = field(default_factory=dict)

    def value(self, word: str) -> int:
        """Return a constant or the value of a variable."""
        return self.numbers.get(_named(word), 0) if word[0] in _WIDTH else int(word)

    def put(self, name: str, value: int) -> None:
        """Set a variable.

        Raises
        ------
        JobError
            The value does not fit.
        """
        if not -(1 << _WIDTH[name[0]]) <= value < 1 << _WIDTH[name[0]]:
            raise JobError(f"{name} cannot hold {value}")
        self.numbers[_named(name)] = value


def _named(word: str) -> str:
    return f"{word[0]}{int(word[1:]):03d}"


@dataclass(frozen=True)
class JointMotion:
    """A `MOVJ`: pulses of the target, share of the joints' speeds in 0.01 %, position level."""

    pulses: tuple[int, ...]
    speed: int
    level: int


class Job:
    """A job as loaded from a JBI file."""

    def __init__(self, text: str) -> None:
        lines = [line.strip() for line in text.splitlines()]
        self.name = next(line.split()[1] for line in lines if line.startswith("//NAME"))
        self.lines = lines[lines.index("NOP") : lines.index("END") + 1]
        self._labels = {line: i for i, line in enumerate(self.lines) if line.startswith("*")}

    def step(self, at: int, variables: Variables) -> tuple[int | None, JointMotion | None]:
        """Carry out the line `at`; return the next line (None at the end) and its motion.

        Raises
        ------
        JobError
            The instruction is unknown or cannot be carried out.
        """
        line = self.lines[at]
        if line == "END":
            return None, None
        if line == "NOP" or line[:1] in ("'", "*"):
            return at + 1, None
        if found := _JUMP.fullmatch(line):
            label, left, relation, right = found.groups()
            equal = left is None or variables.value(left) == variables.value(right)
            return (self._labels[label] if left is None or equal == (relation == "=") else at + 1), None
        if found := _GETE.fullmatch(line):
            variables.put(found[1], self._position(int(found[2]), variables)[int(found[3]) - 1])
            return at + 1, None
        if found := _SUMS.fullmatch(line):
            kind, name, word = found.groups()
            old, value = variables.value(name), variables.value(word)
            variables.put(name, {"SET": value, "ADD": old + value, "MUL": old * value}[kind])
            return at + 1, None
        if found := _MOVE.fullmatch(line):
            speed = variables.value(found[2]) if found[2][0] == "I" else round(100 * float(found[2]))
            if not 1 <= speed <= 10_000:
                raise JobError(f"VJ of {speed / 100} %")
            return at + 1, JointMotion(self._position(int(found[1]), variables), speed, int(found[3]))
        raise JobError(f"unknown instruction {line}")

    def _position(self, number: int, variables: Variables) -> tuple[int, ...]:
        if number not in variables.positions:
            raise JobError(f"P{number:03d} is not defined")
        return variables.positions[number]
