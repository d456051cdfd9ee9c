"""Preload of a worker (`dask worker --preload`) that logs each statement on a data set.

Each statement is a line of a file.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from fleet.diagnose import batch, statement

NOTED = "TRUEPOSE_NOTED"


class Noting:
    """`fleet.diagnose.statement`, which notes that it was asked."""

    REFUSED = statement.REFUSED

    def __init__(self, file: Path) -> None:
        """Log to a file."""
        self._file = file

    def of_diagnosis(self, name: str, found: Any) -> Any:
        """Log and return `statement.of_diagnosis`."""
        return self._noted(name, statement.of_diagnosis(name, found))

    def of_refusal(self, name: str, error: Any) -> Any:
        """Log and return `statement.of_refusal`."""
        return self._noted(name, statement.of_refusal(name, error))

    def _noted(self, name: str, said: Any) -> Any:
        with self._file.open("a", encoding="utf-8") as file:
            file.write(f"{name}\n")
        return said


def dask_setup(_worker: Any) -> None:
    """Runs on the worker when it begins."""
    batch.statement = Noting(Path(os.environ[NOTED]))  # type: ignore[assignment]
