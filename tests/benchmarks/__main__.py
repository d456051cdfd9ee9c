"""`python -m tests.benchmarks [kinematics | identification | diagnosis [N] | demo [N]]`: figures we are held to.

Without a name all but the demos run (twenty take some four minutes). Every figure is a ratio within one run, or a
count over seeded campaigns, so that it means the same on any machine. Exit code 1 when one is missed.
"""

from __future__ import annotations

import argparse
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: one thread against one thread

from tests.benchmarks import demo, diagnosis, identification, kinematics


def main() -> int:
    """Run what was asked for; 0 when every figure is reached."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description="Ratios and counts")
    parser.add_argument("name", nargs="?", choices=("kinematics", "identification", "diagnosis", "demo"))
    parser.add_argument(
        "count", nargs="?", type=int, help="campaigns (diagnosis: 100 of each kind; demo: 20)"
    )
    options = parser.parse_args()
    reached = True
    if options.name in (None, "kinematics"):
        reached &= kinematics.run()
    if options.name in (None, "identification"):
        reached &= identification.run()
    if options.name in (None, "diagnosis"):
        reached &= diagnosis.run(options.count or 100)
    if options.name == "demo":
        reached &= demo.run(options.count or 20)
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())
