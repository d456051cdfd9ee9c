"""Subset of URScript that drivers send: single calls and programs.

A program is `def name(): ... end`, or `sec` for a secondary one. The subset is written from the script manual. It has
movej, stopj, registers, rtde_set_watchdog, sleep, sync and textmsg, names for numbers and lists of them, and a loop
that only waits for an input register. Anything else is an error of the program, which then does not run, as on a
controller.
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
    "write_output_float_register": {"output_register": ..., "value": ...},
    "rtde_set_watchdog": {"variable_name": ..., "min_frequency": ..., "action": "pause"},
    "sleep": {"t": ...},
    "sync": {},
    "textmsg": {"s1": ..., "s2": ""},
}
_HEAD = re.compile(r"(?:def|sec)\s+\w+\(\)\s*:")
_NAMED = re.compile(r"([a-z]\w*) = (.+)")
_LOOP = re.compile(r"while read_input_integer_register\((.+)\) != (.+):")
AWAIT = "await_input"  # the loop that waits, as a call


class ScriptError(ValueError):
    """The controller does not understand the program."""


@dataclass(frozen=True)
class Call:
    """One call with all of its arguments."""

    name: str
    arguments: dict[str, Any]


def _value(node: ast.expr, names: dict[str, Any]) -> Any:
    """Evaluate a literal, a name, or one element of a named list.

    Raises
    ------
    LookupError, TypeError, ValueError
        The expression is none of these.
    """
    if isinstance(node, ast.Name):
        return names[node.id]
    if isinstance(node, ast.Subscript):
        return _value(node.value, names)[_value(node.slice, names)]
    return ast.literal_eval(node)


def parse_call(line: str, names: dict[str, Any] | None = None) -> Call:
    """Parse one line of a program; `names` are the names assigned before.

    Raises
    ------
    ScriptError
        The line is no known call.
    """
    known = names or {}
    try:
        call = ast.parse(line.strip(), mode="eval").body
        if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Name):
            raise ScriptError(f"not a call: {line!r}")
        signature = SIGNATURES[call.func.id]
        given = {name: _value(node, known) for name, node in zip(signature, call.args, strict=False)}
        given |= {str(word.arg): _value(word.value, known) for word in call.keywords}
    except (SyntaxError, ValueError, TypeError, LookupError) as error:
        raise ScriptError(f"{line!r}: {error}") from error
    arguments = signature | given
    if len(call.args) > len(signature) or set(arguments) != set(signature) or ... in arguments.values():
        raise ScriptError(f"wrong arguments: {line!r}")
    _check(call.func.id, arguments)
    return Call(call.func.id, arguments)


def _check(name: str, arguments: dict[str, Any]) -> None:
    """Refuse arguments that the controller refuses at run time.

    Raises
    ------
    ScriptError
        An argument is refused.
    """
    if name == "movej":
        q, numbers = arguments["q"], [arguments[key] for key in "avtr"]
        if not isinstance(q, list) or not all(isinstance(value, int | float) for value in [*q, *numbers]):
            raise ScriptError(f"movej of {arguments}")
        if len(q) != 6 or min(arguments["a"], arguments["v"]) <= 0 or arguments["t"] != 0:
            raise ScriptError(f"movej of {arguments}")
    if name.startswith("write_output") and not isinstance(arguments["value"], int | float):
        raise ScriptError(f"{name} of {arguments}")


def parse_program(lines: list[str]) -> list[Call]:
    """Parse the calls of one program, with or without `def` and `end`.

    Raises
    ------
    ScriptError
        A line cannot be run.
    """
    left = iter(lines[1:-1] if _HEAD.fullmatch(lines[0].strip()) else lines)
    names: dict[str, Any] = {}
    calls: list[Call] = []
    for line in map(str.strip, left):
        named, loop = _NAMED.fullmatch(line), _LOOP.fullmatch(line)
        if named:
            names[named[1]] = _literal(named[2], names)
        elif loop:
            if [next(left, "").strip(), next(left, "").strip()] != ["sync()", "end"]:
                raise ScriptError("only a loop around sync() is simulated")
            register, value = (_literal(text, names) for text in loop.groups())
            calls.append(Call(AWAIT, {"input_register": register, "value": value}))
        else:
            calls.append(parse_call(line, names))
    return calls


def _literal(text: str, names: dict[str, Any]) -> Any:
    try:
        return _value(ast.parse(text.strip(), mode="eval").body, names)
    except (SyntaxError, ValueError, TypeError, LookupError) as error:
        raise ScriptError(f"{text!r}: {error}") from error


class ScriptReader:
    """Splitter of a client's text into programs: single lines, or all from `def` to `end`."""

    def __init__(self) -> None:
        self._rest = ""
        self._lines: list[str] = []

    def feed(self, data: bytes) -> Iterator[list[str]]:
        """Return the programs that `data` completes, as lists of lines."""
        *lines, self._rest = (self._rest + data.decode("latin-1")).split("\n")
        for line in lines:
            if not line.strip():
                continue
            self._lines.append(line)
            heads = sum(each.strip().endswith(":") for each in self._lines)
            ends = sum(each.strip() == "end" for each in self._lines)
            if not _HEAD.fullmatch(self._lines[0].strip()) or ends >= heads:
                program, self._lines = self._lines, []
                yield program
