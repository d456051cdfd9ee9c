"""`python -m tests.conformance [--questions 400] [--rate 0.1] [--jobs 8] [RIG ...]`: every rig x every fault.

Each answer of the device, or each request to it, is spoiled at the given rate, question after question. A cell of the
table says how many questions were answered rightly / failed loudly / were WRONG, after how long the slowest one ended,
and how often the robot was sent elsewhere, which only those do that move on one request. Exit code 1 for a wrong
reading, for an unplanned motion of any other, and for a question that outlived its deadlines.
"""

from __future__ import annotations

import argparse
import os
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: the jobs share few cores

from tests.conformance.matrix import Cell, cells, tables
from tests.conformance.rigs import RIGS


def main() -> int:
    """Print the tables; 0 when nothing was wrong or late."""
    parser = argparse.ArgumentParser(prog="python -m tests.conformance", description=__doc__)
    parser.add_argument("--questions", type=int, default=400)
    parser.add_argument("--rate", type=float, default=0.1)
    parser.add_argument("--jobs", type=int, default=8, help="rigs at a time; they mostly wait")
    parser.add_argument("rig", nargs="*", metavar="RIG", help=", ".join(RIGS))
    options = parser.parse_args()
    if unknown := set(options.rig) - set(RIGS):
        parser.error(f"no rig {', '.join(sorted(unknown))}; there are {', '.join(RIGS)}")
    begin = time.monotonic()
    found: list[Cell] = []
    for each in cells(options.rig or list(RIGS), options.questions, options.rate, options.jobs):
        found.append(each)
        sys.stderr.write(f"{each.rig} {each.fault}: {each}\n")
    sys.stdout.write("\n".join(tables(found)))
    counted = [each for each in found if each.counts]
    sys.stdout.write(
        f"{len(found)} cells, {options.questions} questions each, {options.rate:.0%} of the messages spoiled "
        f"({sum(each.spoiled for each in found)}), {time.monotonic() - begin:.0f} s: "
        f"{sum(each.right for each in counted)} right, {sum(each.loud for each in counted)} failed loudly, "
        f"{sum(each.wrong for each in counted)} wrong ({sum(each.wrong for each in found)} with the cells in "
        f"brackets); beyond their deadlines {sum(each.longest_s > each.allowed_s for each in found)}\n"
    )
    return 0 if all(each.good for each in found) else 1


if __name__ == "__main__":
    sys.exit(main())
