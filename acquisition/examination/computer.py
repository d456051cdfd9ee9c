"""The computer of the cell: calendar, SQLite, disk space, priority, and who uses the robot.

SQLite 3.7.0 to 3.51.2 can damage a write-ahead log that two connections write and reset at once (sqlite.org, "The
WAL-reset bug", 2026-03-13). A record has one writer, which avoids this; a database browser on it does not.

A busy computer must give this program enough of its processor, because a stop has to wait for the processor too. Linux
shares the processor out by session first (autogroup), and within one by niceness. A program may lower its own priority,
but not raise it without the system's permission, and the session also belongs to the user's other programs. A low
priority is therefore only reported, and not changed (docs/decisions/0033).
"""

from __future__ import annotations

import logging
import os
import re
import shutil
import sqlite3
import sys
import tempfile
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from acquisition.cell.cell import Cell
from acquisition.errors import StorageError
from acquisition.examination.finding import Chart
from acquisition.run.run import LEAST_FREE_BYTES
from drivers.errors import LinkLost

_FIXED = (3, 51, 3)
_MEGABYTE = 1_000_000
_EARLIEST = datetime(2026, 11, 1, tzinfo=UTC)  # no computer that runs this program can have a clock before it
_LOG = logging.getLogger(__name__)
_SESSION = Path("/proc/self/autogroup")
WHY = "beside a busy computer a stop may take seconds to reach the robot"
REMEDY = "Start it in a session of its own without nice, as a service of the system, or with less beside it."


def examine_computer(cell: Cell, chart: Chart, record: Path) -> None:
    """Examine the computer; the findings go into `chart`.

    `record` is the folder for the records.
    """
    _calendar(chart)
    _sqlite(chart)
    _room(chart, record)
    _priority(chart)
    _operator(cell, chart)
    for role, url in (("robot", cell.robot.url), ("instrument", cell.instrument.url)):
        if url and "://" not in url:  # a device that a person works has no address
            _serial_port(chart, role, url)


def _calendar(chart: Chart) -> None:
    now = datetime.now(UTC)
    shown = f"{now:%Y-%m-%d %H:%M:%S} UTC"
    if now < _EARLIEST:
        chart.note("clock", f"the calendar says {shown}", "Set date and time: every record bears them.")
    else:
        chart.ok("clock", shown)


def _sqlite(chart: Chart) -> None:
    version = sqlite3.sqlite_version
    if sqlite3.sqlite_version_info < _FIXED:
        chart.note(
            "sqlite",
            f"SQLite {version}, before {'.'.join(map(str, _FIXED))}",
            "Open no record with another program while a campaign runs: that can damage its log.",
        )
    else:
        chart.ok("sqlite", f"SQLite {version}")


def _priority(chart: Chart) -> None:
    if behind := low_priority():
        chart.note("priority", f"{behind}: {WHY}", REMEDY)


def _room(chart: Chart, record: Path) -> None:
    """Check the disk: write a file and remove it again.

    The file is in the folder of the records, or in its nearest existing parent.
    """
    folder = record.absolute()
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        free = shutil.disk_usage(folder).free
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"\0" * 4096)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        chart.fault("record", StorageError(f"{folder} cannot be written: {error.strerror or error}"))
        return
    if free < LEAST_FREE_BYTES:
        least = LEAST_FREE_BYTES // _MEGABYTE
        chart.fault(
            "record", StorageError(f"{folder}: {free // _MEGABYTE} MB free, a campaign needs {least}")
        )
    else:
        chart.ok("record", f"{folder} can be written, {free / 1000 / _MEGABYTE:.1f} GB free")


def _operator(cell: Cell, chart: Chart) -> None:
    if sys.stdin is not None and not sys.stdin.closed and sys.stdin.isatty():
        chart.ok("operator", "a terminal, on which prompts can be answered")
    elif cell.instrument.one_smr or cell.instrument.declared.by_hand or cell.robot.declared.by_hand:
        by_hand = "no terminal, and what is done by hand is asked of a person"
        one_smr = "no terminal, and one_smr asks a person to move the SMR"
        chart.note(
            "operator",
            one_smr if cell.instrument.one_smr else by_hand,
            "Start campaigns in a terminal or from the operator page, else the first prompt ends them.",
        )
    else:
        chart.ok("operator", "no terminal: prompts are for the operator page")


def _serial_port(chart: Chart, role: str, port: str) -> None:
    if os.name != "posix":  # COM5 is no file; only opening it shows whether it is there
        return
    if not Path(port).exists():
        chart.fault(
            "serial",
            LinkLost(
                f"there is no port {port} for the {role}",
                what_to_do="Plug the adapter in, or bind the radio.",
            ),
        )
    elif not os.access(port, os.R_OK | os.W_OK):
        chart.fault(
            "serial",
            LinkLost(
                f"this user may not open {port}",
                what_to_do=f"Add the user to the group that owns {port} (often dialout), then log in again.",
            ),
        )
    else:
        chart.ok("serial", f"{port} exists and may be opened")


def low_priority() -> str:
    """Return a phrase that names what has a lower priority than other programs.

    This can be the session or the program; the phrase is empty if neither has.
    """
    found = None
    with suppress(OSError):
        found = re.search(r" nice (\d+)", _SESSION.read_text("ascii"))
    behind = [f"its session has nice {found[1]}"] if found and int(found[1]) else []
    if hasattr(os, "getpriority") and (nice := os.getpriority(os.PRIO_PROCESS, 0)) > 0:
        behind.append(f"the program has nice {nice}")
    return " and ".join(behind)


def note_low_priority() -> None:
    """Log a warning before a robot is moved if this program has a low priority."""
    if behind := low_priority():
        _LOG.warning("%s: %s. %s", behind, WHY, REMEDY)
