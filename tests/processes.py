"""Processes below another, as Linux lists them. Threads and processes may end while they are being listed."""

from __future__ import annotations

from pathlib import Path

GONE = (FileNotFoundError, ProcessLookupError)


def children_of(pid: int) -> list[int]:
    """The processes that this one began and that still live."""
    try:
        tasks = list(Path(f"/proc/{pid}/task").iterdir())
    except GONE:
        return []
    return [child for task in tasks for child in map(int, _text(task / "children").split())]


def descendants_of(pid: int) -> list[int]:
    """The children of a process, theirs, and so on."""
    return [found for child in children_of(pid) for found in (child, *descendants_of(child))]


def command_of(pid: int) -> str:
    """The command line of a process, its arguments apart by NUL; empty where it has ended."""
    return _text(Path(f"/proc/{pid}/cmdline"))


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except GONE:
        return ""
