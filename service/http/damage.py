"""Runs whose record is damaged: listed like any other, with what can be saved of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from acquisition import State
from acquisition.database import FILE
from acquisition.salvage import salvage
from acquisition.store import Store
from drivers.errors import AcquisitionError, StorageError
from service.wording import counted


def holds_a_record(folder: Path) -> bool:
    """Whether there is a file of a record, whatever is in it."""
    return (folder / FILE).exists()


def look_through(folder: Path) -> None:
    """Every row of a record is what it was. Raises RecordError, StorageError, DamagedRecord."""
    with Store.reading(folder):
        pass


def document_of(folder: Path, error: AcquisitionError) -> dict[str, Any]:
    """The document of a damaged run. It has failed: nothing can be done with it but a rescue."""
    saved, measured, name = 0, 0, folder.name
    try:
        found = salvage(folder)
    except StorageError:
        pass  # `error` says why
    else:
        saved, measured = len(found.readings), found.measured
        name = folder.name if found.campaign is None else found.campaign["name"]
    told = f"{error.message}. {saved} of {counted(measured, 'reading')} can be saved. {error.what_to_do}"
    return {
        "id": folder.name,
        "name": name,
        "state": State.FAILED.value,
        "state_code": State.FAILED.code,
        "reason": told,
        "version": 1,
        "done": saved,
        "total": measured,
        "skipped": 0,
        "prompt": None,
        "last_reading": None,
        "seconds_left": None,
        "simulated": False,
        "dry_run": False,
        "damaged": True,
        "error": error.as_dict(),
    }
