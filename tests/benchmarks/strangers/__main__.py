"""`python -m tests.benchmarks.strangers PART [SEEDS [FIRST]]`: one part from any first seed."""

from __future__ import annotations

import argparse
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: every process has one core

from tests.benchmarks.strangers.bench import FIRST_SEED, PARTS


def main() -> int:
    """Run a part; 0 when every figure is reached."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.strangers")
    parser.add_argument("part", choices=tuple(PARTS))
    parser.add_argument("seeds", nargs="?", type=int, default=1)
    parser.add_argument("first", nargs="?", type=int, default=FIRST_SEED)
    options = parser.parse_args()
    return 0 if PARTS[options.part](options.seeds, options.first) else 1


if __name__ == "__main__":
    sys.exit(main())
