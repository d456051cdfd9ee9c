"""The pages of `docs/extend` are followed literally, each in a copy of the sources."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs" / "extend").glob("*.md"))
PARTS = ("acquisition", "calib", "drivers", "examples", "fleet", "mocks", "service", "tests", "truepose")
OFFLINE = ["--quiet", "--no-index", "--no-deps", "--no-build-isolation", "--target", "site"]


class Block(NamedTuple):
    """A code block: its language, the file it belongs to, and its text."""

    language: str
    file: str
    text: str


def steps(page: Path) -> list[Block]:
    """Return the code blocks of a page.

    Blocks that are only shown belong to no file and have no command, and are left out.
    """
    block = re.compile(r"^```(\w+)(?: file=(\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
    found = [Block(*each) for each in block.findall(page.read_text("utf-8"))]
    return [each for each in found if each.language == "sh" or each.file]


def added(source: str, change: str) -> str:
    """Apply a diff to a source.

    Lines with '+' are added and lines with '-' removed; all but the added lines must occur in the source once.
    """
    lines = change.splitlines()
    old = "".join(line[1:] + "\n" for line in lines if not line.startswith("+"))
    new = "".join(line[1:] + "\n" for line in lines if not line.startswith("-"))
    assert source.count(old) == 1, f"is not there once:\n{old}"
    return source.replace(old, new)


def arguments(line: str) -> list[str]:
    """Return the interpreter's arguments for a line of `python` or `truepose`.

    pip installs without a network.
    """
    program, *words = shlex.split(line)
    assert program in ("python", "truepose")
    if program == "truepose":
        return ["-m", "truepose", *words]
    return ["-m", "pip", "install", *OFFLINE, words[3]] if words[:3] == ["-m", "pip", "install"] else words


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_page_is_right(page: Path, tmp_path: Path) -> None:
    for part in PARTS:
        # with compiled files, except one that another process is writing
        shutil.copytree(ROOT / part, tmp_path / part, ignore=shutil.ignore_patterns("*.pyc.*"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    ran = 0
    for block in steps(page):
        if block.language == "sh":
            for line in block.text.splitlines():
                done = subprocess.run(
                    [sys.executable, *arguments(line)],
                    cwd=tmp_path,
                    env={**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{tmp_path / 'site'}"},
                    capture_output=True,
                    text=True,
                    check=False,
                )
                assert done.returncode == 0, done.stdout + done.stderr
                ran += 1
        elif block.language == "diff":
            path = tmp_path / block.file
            path.write_text(added(path.read_text("utf-8"), block.text), "utf-8")
        else:
            path = tmp_path / block.file
            if path.exists():  # quoted from a file of the sources
                assert block.text in path.read_text("utf-8"), f"is not in {block.file}:\n{block.text}"
            else:
                path.parent.mkdir(exist_ok=True, parents=True)
                path.write_text(block.text, "utf-8")
    assert ran
