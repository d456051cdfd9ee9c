"""A model in another program's format, for a request; called in a worker process."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from service.exports import written
from service.http.work.corrections import for_use
from service.plain import finite


def exported(model_file: Path, model_id: str, kind: str, order: Mapping[str, Any]) -> dict[str, Any]:
    """The document of the answer. `order`: the query of the request. Raises DataError."""
    saved, usable = for_use(model_file, order)
    done = written(saved, usable, model_id, kind, order["conditions"], order["robot_hash"] or None)
    return finite(done.document | {"text": done.text, "about": list(done.about)})
