"""`truepose`, and `python -m truepose`: the command line."""

from __future__ import annotations

import sys

from truepose import rooms


def main() -> int:
    """Run the command line of the process and return its exit code."""
    rooms.take()
    from service.cli import main as run

    return run()


if __name__ == "__main__":
    sys.exit(main())
