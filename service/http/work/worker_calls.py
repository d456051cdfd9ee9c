"""Doors to what routes have done in a worker process. It is imported there: the service is ready without it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

Corrected = tuple[dict[str, Any], list[dict[str, Any]]]


def corrected(model_file: Path, model_id: str, order: Mapping[str, Any]) -> Corrected:
    """Correct targets in a worker, as `corrections.corrected`."""
    from service.http.work import corrections

    return corrections.corrected(model_file, model_id, order)


def corrected_program(
    model_file: Path, model_id: str, name: str, content: bytes, order: Mapping[str, Any]
) -> Corrected:
    """Correct a program in a worker, as `corrections.corrected_program`."""
    from service.http.work import corrections

    return corrections.corrected_program(model_file, model_id, name, content, order)


def exported(model_file: Path, model_id: str, kind: str, order: Mapping[str, Any]) -> dict[str, Any]:
    """Export a model in a worker, as `corrections.exported`."""
    from service.http.work import corrections

    return corrections.exported(model_file, model_id, kind, order)


def exports_listed(model_file: Path, model_id: str, order: Mapping[str, Any]) -> dict[str, Any]:
    """List the exports of a model in a worker, as `corrections.exports_listed`."""
    from service.http.work import corrections

    return corrections.exports_listed(model_file, model_id, order)
