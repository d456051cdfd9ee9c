"""The share of a busy computer that this program gets: a stop waits for the processor as everything does.

Linux shares the processor out by session first (autogroup), and within one by niceness. A program may lower what it
was given, but not raise it without the system's permission, and the session is also that of the user's other programs:
so it is said, and left as it is (docs/decisions/0108).
"""

from __future__ import annotations

import logging
import os
import re
from contextlib import suppress
from pathlib import Path

_LOG = logging.getLogger(__name__)
_SESSION = Path("/proc/self/autogroup")
WHY = "beside a busy computer a stop may take seconds to reach the robot"
REMEDY = "Start it in a session of its own without nice, as a service of the system, or with less beside it."


def low_priority() -> str:
    """A phrase that names what has a lower priority than other programs, the session or the program; empty if none."""
    found = None
    with suppress(OSError):
        found = re.search(r" nice (\d+)", _SESSION.read_text("ascii"))
    behind = [f"its session has nice {found[1]}"] if found and int(found[1]) else []
    if hasattr(os, "getpriority") and (nice := os.getpriority(os.PRIO_PROCESS, 0)) > 0:
        behind.append(f"the program has nice {nice}")
    return " and ".join(behind)


def note_low_priority() -> None:
    """Write it to the log of whoever is about to move a robot, where it is so."""
    if behind := low_priority():
        _LOG.warning("%s: %s. %s", behind, WHY, REMEDY)
