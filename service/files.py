"""JSON for other programs: written whole or not at all, never with a NaN."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calib.text import replace_file

STANDARD_OUTPUT = "-"


def as_json(document: Mapping[str, Any]) -> str:
    """Return the document as JSON text.

    Raises
    ------
    ValueError
        The document holds NaN or an infinity.
    """
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def write_json(document: Mapping[str, Any], to: str | None) -> None:
    """Write a document to the file `to`, to standard output for '-', nowhere for None."""
    if to is None:
        return
    if to == STANDARD_OUTPUT:
        sys.stdout.write(as_json(document))
        sys.stdout.flush()
        return
    replace_file(Path(to), as_json(document))
