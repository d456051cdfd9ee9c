"""`python -m tests.figures WHAT ...`: measure, enter in the history, write `docs/evidence/history.md`.

WHAT is a name of `python -m tests.benchmarks` with its count (`floor:50`, `selection`), `mutants` (`mutants:link`:
of files so named), `conformance` (`conformance:ur-rtde`: of that rig) or `lines` (`lines:tests/calib`: those that these
tests reach). Without WHAT only the page is written. What breaks off is not entered, and the exit code is 1; a figure
that is missed is entered like any other.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tests.figures.history import ROOT, append, measured, read
from tests.figures.page import PAGE, page

_ROOMS = "acquisition,calib,drivers,fleet,mocks,service,truepose"


def commands(what: str) -> list[list[str]]:
    """The commands behind one word, without `python`; the figures are what the last of them prints."""
    name, _, part = what.partition(":")
    parts = [part] if part else []
    if name == "mutants":
        return [["-m", "tests.sabotage.mutants", "--sample", "40", *(["--only", part] if part else [])]]
    if name == "conformance":
        return [["-m", "tests.conformance", "--questions", "400", *parts]]
    if name == "lines":
        tests = ["-m", "pytest", "-q", *parts]
        return [["-m", "coverage", "run", "--source", _ROOMS, *tests], ["-m", "coverage", "report"]]
    return [["-m", "tests.benchmarks", name, *parts]]


def main() -> int:
    """Run one after the other; what is through is entered before the next begins."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.figures",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("what", nargs="*", metavar="WHAT")
    broken = 0
    for what in parser.parse_args().what:
        try:
            *first, last = commands(what)
            for command in first:
                subprocess.run([sys.executable, *command], cwd=ROOT, check=True)
            run = measured(what, last)
        except (RuntimeError, subprocess.CalledProcessError) as error:
            sys.stderr.write(f"{error}\n")
            broken += 1
        else:
            append(run)
    PAGE.write_text(page(read()), "utf-8")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
