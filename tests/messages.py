"""`python -m tests.messages [WORD]`: every message of an error in a list, to be read aloud.

A message is what an error is given where it is raised, and the advice of its class. {...} is what is filled in when it
happens. WORD: only files whose name holds it.
"""

from __future__ import annotations

import argparse
import ast
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROOMS = ("calib", "drivers", "acquisition", "fleet", "service", "truepose", "mocks")
_FOUNDERS = {"DataError", "Exception", "ValueError", "AssertionError", "RuntimeError", "HTTPException"}
_SPEAKERS = {"warn", "error", "failed"}  # of warnings, of a parser of arguments


@dataclass(frozen=True)
class Message:
    """What is said, and where: the file from the root, its line, and the name of the error."""

    file: str
    line: int
    error: str
    text: str


def messages(word: str = "") -> list[Message]:
    """Every message of the files whose name holds the word, in their order."""
    errors = _errors()
    return [
        message
        for name, tree in _trees().items()
        if word in name
        for message in sorted(set(_of_file(name, tree, errors)), key=lambda each: each.line)
    ]


@cache
def _trees() -> dict[str, ast.Module]:
    files = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
    return {path.relative_to(ROOT).as_posix(): ast.parse(path.read_text("utf-8")) for path in files}


def _errors() -> set[str]:
    """Names of all classes of errors, own ones by their bases and Python's by their last word."""
    bases = {
        node.name: {_name(base) for base in node.bases}
        for tree in _trees().values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    found = set(_FOUNDERS)
    while grown := {name for name, of in bases.items() if of & found} - found:
        found |= grown
    return found


def _of_file(name: str, tree: ast.Module, errors: set[str]) -> Iterator[Message]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and (
            _name(node.func) in errors | _SPEAKERS or _name(node.func).endswith("Error")
        ):
            given = [
                *node.args,
                *(each.value for each in node.keywords if each.arg not in ("key", "device", "code")),
            ]
            for each in given:
                for text in _said(each):
                    yield Message(name, each.lineno, _name(node.func), text)
        elif isinstance(node, ast.ClassDef) and node.name in errors:
            for line in node.body:
                if isinstance(line, ast.Assign) and _name(line.targets[0]) == "advice":
                    for text in _said(line.value):
                        yield Message(name, line.lineno, node.name, text)


def _said(node: ast.expr) -> Iterator[str]:
    """The sentences of an expression; one that is a single word is a name, not a sentence."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
        yield node.value
    elif isinstance(node, ast.JoinedStr):
        text = "".join(
            str(part.value) if isinstance(part, ast.Constant) else f"{{{ast.unparse(_filled(part))}}}"
            for part in node.values
        )
        if " " in text.strip():
            yield text
    elif isinstance(node, ast.IfExp):
        yield from _said(node.body)
        yield from _said(node.orelse)
    elif isinstance(node, ast.BinOp):
        yield from _said(node.left)
        yield from _said(node.right)


def _filled(part: ast.expr) -> ast.expr:
    return part.value if isinstance(part, ast.FormattedValue) else part


def _name(node: ast.expr) -> str:
    """The last word of a name with dots."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def main() -> int:
    """Print the list, file by file."""
    parser = argparse.ArgumentParser(prog="python -m tests.messages", description=__doc__)
    parser.add_argument("word", nargs="?", default="", help="only files whose name holds it")
    before = ""
    for each in messages(parser.parse_args().word):
        if each.file != before:
            sys.stdout.write(f"\n{each.file}\n")
        sys.stdout.write(f"  {each.line:4d} {each.error}: {each.text}\n")
        before = each.file
    return 0


if __name__ == "__main__":
    sys.exit(main())
