"""The little of URScript that drivers send: single calls, and programs `def name(): ... end` of calls.

Written from the script manual: movej, stopj, write_output_integer_register, rtde_set_watchdog, sleep, sync,
textmsg. Anything else is an error of the program, which then does not run, as on a controller.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

SIGNATURES: dict[str, dict[str, Any]] = {  # argument: default; ... must be given
    "movej": {"q": ..., "a": 1.4, "v": 1.05, "t": 0.0, "r": 0.0},
    "stopj": {"a": ...},
    "write_output_integer_register": {"output_register": ..., "value": ...},
    "rtde_set_watchdog": {"variable_name": ..., "min_frequency": ..., "action": "pause"},
    "sleep": {"t": ...},
    "sync": {},
    "textmsg": {"s1": ..., "s2": ""},
}
_HEAD = re.compile(r"def\s+\w+\(\)\s*:")


class ScriptError(ValueError):
    """The controller does not understand the program."""


@dataclass(frozen=True)
class Call:
    """One call with all of its arguments."""

    name: str
    arguments: dict[str, Any]


def parse_call(line: str) -> Call:
    """One line of a program. Raises ScriptError."""
    try:
        call = ast.parse(line.strip(), mode="eval").body
        if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Name):
            raise ScriptError(f"not a call: {line!r}")
        signature = SIGNATURES[call.func.id]
        given = dict(zip(signature, map(ast.literal_eval, call.args), strict=False))
        given |= {str(word.arg): ast.literal_eval(word.value) for word in call.keywords}
    except (SyntaxError, ValueError, TypeError, KeyError) as error:
        raise ScriptError(f"{line!r}: {error}") from error
    arguments = signature | given
    if len(call.args) > len(signature) or set(arguments) != set(signature) or ... in arguments.values():
        raise ScriptError(f"wrong arguments: {line!r}")
    return Call(call.func.id, arguments)


def parse_program(lines: list[str]) -> list[Call]:
    """The calls of one program, with or without `def` and `end`. Raises ScriptError."""
    body = lines[1:-1] if _HEAD.fullmatch(lines[0].strip()) else lines
    return [parse_call(line) for line in body]


class ScriptReader:
    """Cuts what a client sends into programs: a line by itself, or everything from `def` to `end`."""

    def __init__(self) -> None:
        self._rest = ""
        self._lines: list[str] = []

    def feed(self, data: bytes) -> Iterator[list[str]]:
        """The programs that `data` completes, as lists of lines."""
        *lines, self._rest = (self._rest + data.decode("latin-1")).split("\n")
        for line in lines:
            if not line.strip():
                continue
            self._lines.append(line)
            if not _HEAD.fullmatch(self._lines[0].strip()) or line.strip() == "end":
                program, self._lines = self._lines, []
                yield program
