"""The figures that were measured, one line of a command's output a row, in `history.csv` beside this file."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryFile

ROOT = Path(__file__).parents[2]
HISTORY = Path(__file__).with_name("history.csv")


@dataclass(frozen=True)
class Run:
    """What was run (a word of `tests.figures`), when (UTC), on which commit (`+`: changed since), and what it printed.

    load: of the minute before the run began and of its last minute; exit: 0 when every figure was reached, or 1.
    """

    date: str
    commit: str
    cores: int
    load_before: float
    load_after: float
    seconds: float
    what: str
    exit: int
    lines: tuple[str, ...]


HEADER = (*[field.name for field in fields(Run)][:-1], "line")


def measured(what: str, command: Sequence[str]) -> Run:
    """Run `python COMMAND` in the root of the sources, showing its lines as they come.

    Raises RuntimeError where it broke off or printed nothing: that is no figure.
    """
    commit, date = _commit(), datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S")
    before, begin = os.getloadavg()[0], time.monotonic()
    lines = []
    environment = {**os.environ, "PYTHONUTF8": "1"}
    with (
        TemporaryFile("w+", encoding="utf-8") as complaints,
        subprocess.Popen(
            [sys.executable, *command],
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=complaints,
            encoding="utf-8",
        ) as process,
    ):
        assert process.stdout is not None
        for line in process.stdout:
            sys.stdout.write(line)
            sys.stdout.flush()
            lines.append(line.rstrip())
        code = process.wait()
        complaints.seek(0)
        said = complaints.read()
    # A command that misses a figure ends with 1, and so does Python where it breaks off
    if code not in (0, 1) or "Traceback (most recent call last)" in said or not any(lines):
        raise RuntimeError(f"python {' '.join(command)} ended with {code}; nothing is entered.\n{said}")
    spent, after = time.monotonic() - begin, os.getloadavg()[0]
    rounded = round(before, 1), round(after, 1), round(spent, 1)
    return Run(date, commit, os.cpu_count() or 0, *rounded, what, code, tuple(lines))


def append(run: Run, history: Path = HISTORY) -> None:
    """Enter the lines of a run behind the others."""
    new = not history.exists()
    with history.open("a", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        if new:
            out.writerow(HEADER)
        *of_run, lines = astuple(run)
        out.writerows((*of_run, line) for line in lines)


def read(history: Path = HISTORY) -> list[Run]:
    """Every run, oldest first."""
    with history.open(encoding="utf-8", newline="") as file:
        rows = csv.reader(file)
        if tuple(next(rows)) != HEADER:
            raise ValueError(f"{history}: the columns are not {', '.join(HEADER)}")
        runs: dict[tuple[str, ...], list[str]] = {}
        for *of_run, line in rows:
            runs.setdefault(tuple(of_run), []).append(line)
    return [
        Run(
            date,
            commit,
            int(cores),
            float(before),
            float(after),
            float(spent),
            what,
            int(code),
            tuple(lines),
        )
        for (date, commit, cores, before, after, spent, what, code), lines in runs.items()
    ]


def _commit() -> str:
    """The commit in short, with `+` where a file of the program or of the tests has changed since."""
    git = ["git", "-C", str(ROOT)]
    named = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True)
    rooms = ("acquisition", "calib", "drivers", "fleet", "mocks", "service", "tests/*.py", "truepose")
    status = [*git, "status", "--porcelain", "--untracked-files=all", "--", *rooms]
    changed = subprocess.run(status, capture_output=True, text=True, check=True)
    return named.stdout.strip() + ("+" if changed.stdout.strip() else "")
