"""The document of a run: measured, only checked, or damaged."""

from __future__ import annotations

from typing import Any

from acquisition import Event, RunStatus
from drivers.errors import AcquisitionError
from service.json_values import finite, utc_text

FINAL = ("succeeded", "failed")
"""States of a run to which nothing can happen any more."""


def run_document(
    run_id: str, status: RunStatus, *, dry_run: bool = False, error: AcquisitionError | None = None
) -> dict[str, Any]:
    """Return the members of `RunResponse`.

    `run_id` is the id of the run in the service. `error` is the reason why it ended, or cannot be read.
    """
    shown = None if error is None else error.as_dict()
    early = status.finished_early
    return finite(status.as_dict()) | {
        "id": run_id,
        "dry_run": dry_run,
        "error": shown,
        "finished_early": early and early | {"utc": utc_text(early["utc"])},
    }


def event_document(event: Event) -> dict[str, Any]:
    """Return the members of `EventShown`."""
    return finite(event.as_dict()) | {"utc": utc_text(event.utc)}
