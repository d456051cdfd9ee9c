"""`python -m tests.conformance.wire [NAME ...]`: sample traffic of each protocol.

The traffic passes between driver and simulator. Robots connect, are armed, move and are read; instruments connect,
are armed and measure. Columns: time (s), device, `>` to it, `<` from it or `!` opened and closed, data. Of a long
conversation, the program shows the beginning, the first lines of the move or of the reading, and the end.
"""

from __future__ import annotations

import io
import json
import logging
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack

from drivers import WireLog
from tests.conformance.readings import READINGS

BEGINNING, MOVE, END, WIDEST = 4, 6, 4, 32
GOAL_DEG = (10.5, -20.25, 15.0, -5.0, 30.0, 40.125)


def log_of(name: str) -> tuple[list[str], int]:
    """Return all lines of one protocol, and the first line of the move or last reading.

    Times count from the beginning.
    """
    begin = time.monotonic()
    stream = io.StringIO()
    with ExitStack() as stack:
        bench = READINGS[name](stack, WireLog(stream, lambda: time.monotonic() - begin))
        if bench.arm is not None:
            bench.arm.arm()
        before = stream.getvalue().count("\n")
        if bench.arm is not None:
            bench.arm.move_to(GOAL_DEG)
        bench.read()
    return stream.getvalue().splitlines(), before


def shown(line: str) -> str:
    """Text as it is, anything else in hexadecimal."""
    row = json.loads(line)
    text = row["data"].replace("\n", "\\n")
    if not (text.isprintable() and text.isascii()):
        data = row["data"].encode("latin-1")
        text = data[:WIDEST].hex(" ", -2) + (f" ... {len(data)} bytes" if len(data) > WIDEST else "")
    return f"{row['t_s']:.4f} {row['device']:<16} {row['dir']} {text}"


def shortened(lines: list[str], middle: int) -> Iterator[str]:
    """Yield the beginning, the part from the middle on, and the end; count the omitted lines."""
    last = -1
    for i, line in enumerate(lines):
        if i < BEGINNING or 0 <= i - middle < MOVE or len(lines) - i <= END:
            if i - last > 1:
                yield f"       ... {i - last - 1} more"
            last = i
            yield shown(line)


def main() -> int:
    """Print the sample traffic of the named protocols."""
    logging.disable(
        logging.WARNING
    )  # every driver says that it is unverified on hardware; the page says it too
    for name in sys.argv[1:] or READINGS:
        sys.stdout.write(f"### {name}\n\n```\n" + "\n".join(shortened(*log_of(name))) + "\n```\n\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
