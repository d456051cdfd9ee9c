"""The help of every command fits a terminal of 80 columns, and no line of it is cut."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from typer.main import get_command

from service.commands import app

COLUMNS = 80


def helps(command: Any, words: tuple[str, ...], parent: Any = None) -> Iterator[tuple[tuple[str, ...], str]]:
    """Words and help of a command and of those below it."""
    context = command.context_class(command, info_name=words[-1], parent=parent)
    yield words, command.get_help(context)
    for name, each in getattr(command, "commands", {}).items():
        yield from helps(each, (*words, name), context)


def test_no_line_is_cut_and_none_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(COLUMNS))
    found = dict(helps(get_command(app), ("truepose",)))
    assert ("truepose", "campaign", "run") in found
    for words, text in found.items():
        for line in text.splitlines():
            assert len(line) <= COLUMNS, words
            assert line.startswith("Usage:") or not line.endswith("..."), f"{words}: {line}"
