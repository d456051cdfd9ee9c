"""`truepose`, and `python -m truepose`: the command line, once it is sure that its packages are its own."""

from __future__ import annotations

import sys

from truepose.rooms import refuse_foreign


def main() -> int:
    """Run the command line of the process and return its exit code."""
    try:
        refuse_foreign()
    except ImportError as error:
        sys.stderr.write(f"truepose: {error}\n")
        return 1
    from service.cli import main as run

    return run()


if __name__ == "__main__":
    sys.exit(main())
