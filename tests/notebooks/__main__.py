"""`python -m tests.notebooks [NAME ...]`: run the notebooks of docs/notebooks.

Their text output and pictures are kept.

A notebook whose measurements are not on this machine is left as it is, and named.
"""

from __future__ import annotations

import argparse
import sys

from tests.notebooks.run import NOTEBOOKS, execute, lacks, write


def main() -> int:
    """Run them; 0 when each that could be run was."""
    parser = argparse.ArgumentParser(prog="python -m tests.notebooks", description=__doc__)
    parser.add_argument(
        "name", nargs="*", metavar="NAME", help="without its ending; all of them where none is given"
    )
    names = parser.parse_args().name
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        if names and path.stem not in names:
            continue
        if why := lacks(path):
            sys.stderr.write(f"{path.stem}: left as it is: {why}\n")
            continue
        write(path, execute(path))
        sys.stderr.write(f"{path.stem}: written\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
