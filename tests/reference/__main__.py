"""`python -m tests.reference [NAME ...]` makes the certified problems again; `--table` counts the program's digits."""

from __future__ import annotations

import argparse
import sys
import time

from tests.reference.files import make
from tests.reference.problems import PLANS


def main() -> int:
    """Make the problems named, or all of them; or count digits."""
    parser = argparse.ArgumentParser(prog="python -m tests.reference", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(PLANS)}; default all")
    parser.add_argument("--table", action="store_true", help="print the digits that the program gets right")
    options = parser.parse_args()
    if unknown := set(options.names) - set(PLANS):
        parser.error(f"there is no problem {', '.join(sorted(unknown))}")
    if options.table:
        from tests.certified.digits import (
            table,
        )  # the program under test: the reference itself imports none of it

        sys.stdout.write(table(options.names or PLANS) + "\n")
        return 0
    for name in options.names or PLANS:
        began = time.monotonic()
        made = make(name)
        sys.stdout.write(
            f"{name:20} {len(made.estimate)} parameters, {made.degrees_of_freedom} degrees of freedom,"
            f" sum of squares {made.sum_of_squares:.6g}, condition {made.condition:.3g},"
            f" {made.iterations} iterations, {time.monotonic() - began:.0f} s\n"
        )
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
