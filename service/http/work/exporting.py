"""A model in another program's format, for a request; called in a worker process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calib.compensate import Bounds
from calib.saved import load_model
from service.exports import written
from service.plain import finite


def exported(
    model_file: Path, model_id: str, kind: str, conditions: str, robot_hash: str, bounds: Bounds
) -> dict[str, Any]:
    """The document of the answer. Raises DataError."""
    saved = load_model(model_file, bounds=bounds)
    done = written(saved, model_id, kind, conditions, robot_hash or None)
    return finite(done.document | {"text": done.text, "about": list(done.about)})
