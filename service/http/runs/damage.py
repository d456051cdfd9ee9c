"""Runs whose record is damaged: listed like any other, with what can be saved of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from acquisition import RunStatus, State
from acquisition.errors import DamagedRecord, RecordError, RecordInUse, StorageError
from acquisition.record import FILE, LOCK, RecordStore, is_begun, is_owned, salvage
from drivers.errors import AcquisitionError
from service.http.runs.run_document import run_document
from service.wording import counted

# Largest size of a file that is looked through while the service starts; a night has some 20 MB
MOST_BYTES = 256 * 1024 * 1024


def holds_a_record(folder: Path) -> bool:
    """Return whether a folder has a record file, with any content; True if it cannot be read."""
    try:
        return (folder / FILE).exists()
    except OSError:
        return True


def was_cut_off(folder: Path) -> bool:
    """Return whether the making of a record was interrupted before it held a campaign, and nothing else is there."""
    file = folder / FILE
    if not file.is_file() or not file.stat().st_size or is_begun(folder) or is_owned(folder):
        return False  # a file that was emptied may have been a record
    return all(each.name.startswith(FILE) or each.name == LOCK for each in folder.iterdir())


def look_through(folder: Path) -> None:
    """Verify every row of a record.

    Raises
    ------
    RecordError, StorageError, DamagedRecord
        The record cannot be read, or a row has changed.
    """
    with RecordStore.reading(folder):
        pass


def unreadable(folder: Path, error: Exception) -> DamagedRecord:
    """Return the error of a folder, or of a dry run in it, that cannot be read."""
    return DamagedRecord(f"{folder}: cannot be read ({error})")


class Damaged:
    """The damaged runs of a folder, set aside so that other runs can continue."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._documents: dict[str, dict[str, Any]] = {}

    def set_aside(self, name: str, error: AcquisitionError) -> dict[str, Any]:
        """Return the document of a run, and keep it if its record is damaged for good."""
        document = document_of(self._folder / name, error)
        if not isinstance(error, StorageError) or isinstance(error, DamagedRecord):
            self._documents[name] = document  # otherwise the cause may differ the next time
        return document

    @contextmanager
    def met(self, name: str) -> Iterator[None]:
        """Set a run aside if it turns out to be damaged within this block.

        The block reads a run for the first time. No errors of acquisition come out. A run that another program has
        open is not damaged, and is not set aside.
        """
        folder = self._folder / name
        try:
            yield
        except RecordInUse:
            pass
        except AcquisitionError as error:
            if holds_a_record(folder):
                self.set_aside(name, error)
        except OSError as error:
            self.set_aside(name, unreadable(folder, error))

    def document(self, name: str) -> dict[str, Any] | None:
        """Return the document of a run that was set aside; None of any other."""
        return self._documents.get(name)

    def forget(self, name: str) -> None:
        """Forget a run that is deleted."""
        self._documents.pop(name, None)


def document_of(folder: Path, error: AcquisitionError) -> dict[str, Any]:
    """Return the document of a damaged run, or one of another version.

    The run has failed, and is only listed.
    """
    saved, measured, name, looked = 0, 0, folder.name, True
    try:
        looked = (folder / FILE).stat().st_size <= MOST_BYTES
        if looked:
            found = salvage(folder)
            saved, measured = len(found.readings), found.measured
            name = folder.name if found.campaign is None else found.campaign["name"]
    except RecordError:
        looked = False  # another version of the program reads it
    except (StorageError, OSError):
        pass  # `error` has the reason
    can = f"{saved} of {counted(measured, 'reading')} can be saved. " if looked else ""
    reason = f"{error.message}. {can}{error.what_to_do}"
    status = RunStatus(
        id=folder.name,
        name=name,
        state=State.FAILED.value,
        state_code=State.FAILED.code,
        reason=reason,
        version=1,
        done=saved,
        total=measured,
    )
    return run_document(folder.name, status, error=error) | {"damaged": True}
