"""Names of files that the program ships or creates, which Windows must be able to store.

No Windows machine has been available to try it.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("acquisition", "calib", "drivers", "fleet", "mocks", "service", "truepose")
FORBIDDEN = re.compile(r'[<>:"|?*\\\x00-\x1f]|[. ]$')
DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)


def lawful(name: str) -> bool:
    """Report whether Windows stores a file of that name.

    Source: Microsoft, Naming Files, Paths, and Namespaces.
    """
    return not FORBIDDEN.search(name) and not DEVICES.fullmatch(name)


@pytest.mark.parametrize("name", ["aux.py", "NUL", "a:b.json", "what?", "dot.", "com1.log", "x|y"])
def test_unlawful_names_are_seen(name: str) -> None:
    assert not lawful(name)


def test_what_comes_with_the_program_can_be_stored() -> None:
    found = [
        path.relative_to(ROOT)
        for room in (*ROOMS, "docs", "examples", "deploy", "tests")
        for path in (ROOT / room).rglob("*")
    ]
    assert len(found) > 1000
    assert [path for path in found if not all(map(lawful, path.parts))] == []
    letters = Counter(path.as_posix().lower() for path in found)
    assert [name for name, count in letters.items() if count > 1] == []  # it does not tell a from A
    assert (
        max(len(path.as_posix()) for path in found if path.parts[0] in ROOMS) < 120
    )  # of 260 with the folder


def written() -> Iterator[tuple[str, str]]:
    """Yield file and name for every constant name after a `/` of paths.

    Inserted values (ids, numbers) become a 0.
    """
    for path in (path for room in ROOMS for path in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
                parts = node.right.values if isinstance(node.right, ast.JoinedStr) else [node.right]
                texts = [part.value if isinstance(part, ast.Constant) else "0" for part in parts]
                if all(isinstance(text, str) for text in texts) and texts != ["0"]:
                    yield path.relative_to(ROOT).as_posix(), "".join(map(str, texts))


def test_what_the_program_writes_can_be_stored() -> None:
    names = list(written())
    assert len(names) > 30
    bad = [each for each in names if not all(map(lawful, PurePosixPath(each[1]).parts))]
    assert bad == []
