"""`truepose`, and `python -m truepose`: the command line, after a check of its packages.

The packages of the program have plain names, which a package of another project may hide.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

ROOMS = ("acquisition", "calib", "drivers", "fleet", "mocks", "service")


def where(name: str) -> Path | None:
    """Return the folder in which Python finds a package.

    It is None if Python finds none, or one that is in no folder.
    """
    loaded = sys.modules.get(name)
    spec = find_spec(name) if loaded is None else loaded.__spec__
    if spec is None or not spec.submodule_search_locations:
        return None
    return Path(next(iter(spec.submodule_search_locations))).resolve()


def refuse_foreign(rooms: Iterable[str] = ROOMS) -> None:
    """Refuse to start if Python finds another package under the name of one of the program.

    Raises
    ------
    ImportError
        A package is missing, or another one is found.
    """
    home = Path(__file__).resolve().parents[1]
    for name in rooms:
        found = where(name)
        if found == home / name:
            continue
        there = f"{found} is found instead" if found else "there is none"
        raise ImportError(
            f"truepose needs its own package '{name}', in {home}, but {there}. Install TruePose in a separate "
            "environment, or start Python in another folder; PYTHONPATH may name one that holds such a package."
        )


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
