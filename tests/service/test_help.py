"""The help of every command.

It fits a terminal of 80 and of 60 columns, no line is cut, and no help waits for the import of numerics.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from service.commands import COMMANDS, app, load


def helps(command: Any, words: tuple[str, ...], parent: Any = None) -> Iterator[tuple[tuple[str, ...], str]]:
    """Words and help of a command and of those below it."""
    context = command.context_class(command, info_name=words[-1], parent=parent)
    yield words, command.get_help(context)
    for name, each in getattr(command, "commands", {}).items():
        yield from helps(load(name) if parent is None else each, (*words, name), context)


@pytest.mark.parametrize("columns", [80, 60])
def test_no_line_is_cut_and_none_too_long(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    found = dict(helps(app, ("truepose",)))
    assert ("truepose", "campaign", "run") in found
    for words, text in found.items():
        for line in text.splitlines():
            assert len(line) <= columns, words
            assert line.startswith("Usage:") or not line.endswith("..."), f"{words}: {line}"


def test_a_summary_is_the_first_sentence_of_the_help() -> None:
    for name, (_, summary) in COMMANDS.items():
        assert " ".join(load(name).help.split()).startswith(summary), name
        assert "." not in summary[:-1]


WITHOUT = """
import sys
{script}
sys.exit(", ".join(each for each in {names} if each in sys.modules) or 0)
"""


@pytest.mark.parametrize(
    ("script", "names"),
    [
        ("from service.cli import main; main(['--help'])", ["numpy", "fastapi", "calib", "drivers"]),
        (
            "import service.http.app",
            [
                "matplotlib",
                "scipy.stats",
                "scipy.optimize",
                "jinja2",
                "rich",
                "service.programs",
                "calib.motion",
            ],
        ),
    ],
)
def test_what_starts_loads_nothing_that_it_does_not_need(script: str, names: list[str]) -> None:
    command = [sys.executable, "-c", WITHOUT.format(script=script, names=names)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.stderr, done.returncode) == ("", 0)
