"""Tokens and literals of RAPID and URScript: numbers, names, strings, bracketed lists.

Only the content of literals is understood. Anything else is `SyntaxUnknown`, with its line, and left alone by
the caller.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from calib.errors import DataError
from service.programs.text import Lines

DEEPEST = 16
"""Brackets within brackets of one value; a wobjdata in an array has five."""
_OPEN, _CLOSE = "([{", ")]}"


@dataclass(frozen=True)
class Token:
    """A word of the program: kind is 'number', 'name', 'string' or 'sign'."""

    kind: str
    text: str
    start: int
    end: int


@dataclass(frozen=True)
class Node:
    """A literal.

    Its kind is 'number', 'name', 'string', 'list', 'call' (name and arguments) or 'element' (name{...}).
    """

    kind: str
    start: int
    end: int
    text: str = ""
    value: float = 0.0
    items: tuple[Node, ...] = ()


class SyntaxUnknown(Exception):
    """Something this parser does not know, at a position of the text."""

    def __init__(self, at: int, what: str) -> None:
        super().__init__(what)
        self.at = at


def lexer(comment: str, quotes: str) -> Callable[[str, Lines, str], list[Token]]:
    """Create the function (text, its lines, file) that splits a language into tokens.

    `comment` begins a remark that runs to the end of its line.
    """
    strings = "|".join(f"{q}[^{q}\r\n]*+{q}" for q in quotes)
    pattern = re.compile(
        rf"(?P<space>\s+|{comment}[^\r\n]*)|(?P<string>{strings})|(?P<name>[^\W\d]\w*)"
        r"|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<sign>:=|.)",
    )

    def tokens(text: str, lines: Lines, file: str) -> list[Token]:
        out = []
        for match in pattern.finditer(text):
            kind = match.lastgroup or "sign"
            if kind == "space":
                continue
            if kind == "sign" and match.group() in quotes:
                raise DataError(
                    "a string is not closed.",
                    do="Close it on its line.",
                    file=file,
                    line=lines.at(match.start()),
                )
            out.append(Token(kind, match.group(), match.start(), match.end()))
        return out

    return tokens


def brackets(tokens: Sequence[Token]) -> dict[int, int]:
    """Map the index of every opening bracket to that of its closing one.

    Brackets that are not closed are left out.
    """
    out: dict[int, int] = {}
    left: list[int] = []
    for i, token in enumerate(tokens):
        if token.kind == "sign" and token.text in _OPEN:
            left.append(i)
        elif token.kind == "sign" and token.text in _CLOSE and left:
            out[left.pop()] = i
    return out


def _closing(tokens: Sequence[Token], at: int) -> int:
    """Return the index of the bracket that closes the one at `at`.

    Raises
    ------
    SyntaxUnknown
        There is none.
    """
    depth = 0
    for i in range(at, len(tokens)):
        if tokens[i].kind == "sign" and tokens[i].text in _OPEN:
            depth += 1
        elif tokens[i].kind == "sign" and tokens[i].text in _CLOSE:
            depth -= 1
            if depth == 0:
                return i
    raise SyntaxUnknown(tokens[at].start, "a bracket is not closed")


def split(tokens: Sequence[Token], *separators: str) -> list[list[Token]]:
    """Split tokens at separators outside brackets.

    A separator begins its part, except ','.
    """
    parts: list[list[Token]] = [[]]
    depth = 0
    for token in tokens:
        if token.kind == "sign":
            depth += (token.text in _OPEN) - (token.text in _CLOSE)
            if depth == 0 and token.text in separators:
                parts.append([] if token.text == "," else [token])
                continue
        parts[-1].append(token)
    return parts


def literal(tokens: Sequence[Token], depth: int = 0) -> Node:
    """Parse all tokens as one literal, inside `depth` brackets.

    Raises
    ------
    SyntaxUnknown
        The tokens are no literal.
    """
    if not tokens:
        raise SyntaxUnknown(0, "nothing is here")
    if depth > DEEPEST:
        raise SyntaxUnknown(tokens[0].start, f"more than {DEEPEST} brackets lie within one another")
    node, used = _literal(tokens, 0, depth)
    if used != len(tokens):
        raise SyntaxUnknown(tokens[used].start, f"'{tokens[used].text}' is not part of a plain value")
    return node


def _literal(tokens: Sequence[Token], at: int, depth: int) -> tuple[Node, int]:
    if at >= len(tokens):
        raise SyntaxUnknown(tokens[-1].end, "the value ends too early")
    token = tokens[at]
    if token.kind == "sign" and token.text in "+-" and at + 1 < len(tokens):
        number = tokens[at + 1]
        if number.kind == "number":
            value = _number(number) * (-1.0 if token.text == "-" else 1.0)
            return Node("number", token.start, number.end, token.text + number.text, value), at + 2
    if token.kind == "number":
        return Node("number", token.start, token.end, token.text, _number(token)), at + 1
    if token.kind == "string":
        return Node("string", token.start, token.end, token.text), at + 1
    if token.kind == "name":
        follows = tokens[at + 1] if at + 1 < len(tokens) else None
        if follows is not None and follows.kind == "sign" and follows.text in _OPEN:
            end = _closing(tokens, at + 1)
            kind = {"(": "call", "{": "element", "[": "list"}[follows.text]
            # The arguments of a call may be anything: only the first is read, if it is a plain value.
            read = _plain if kind == "call" else _items
            items = read(tokens[at + 2 : end], depth + 1)
            return Node(kind, token.start, tokens[end].end, token.text, items=items), end + 1
        return Node("name", token.start, token.end, token.text), at + 1
    if token.text == "[":
        end = _closing(tokens, at)
        items = _items(tokens[at + 1 : end], depth + 1)
        return Node("list", token.start, tokens[end].end, items=items), end + 1
    raise SyntaxUnknown(token.start, f"'{token.text}' is not part of a plain value")


def _number(token: Token) -> float:
    value = float(token.text)
    if not math.isfinite(value):
        raise SyntaxUnknown(token.start, f"'{token.text[:20]}' is larger than any number")
    return value


def _items(tokens: Sequence[Token], depth: int) -> tuple[Node, ...]:
    return tuple(literal(part, depth) for part in split(tokens, ",")) if tokens else ()


def _plain(tokens: Sequence[Token], depth: int) -> tuple[Node, ...]:
    out = []
    for part in split(tokens, ","):
        try:
            out.append(literal(part, depth))
        except SyntaxUnknown:
            out.append(Node("unknown", part[0].start if part else 0, part[-1].end if part else 0))
    return tuple(out)
