"""The record of a campaign as documents of a fleet: its readings as a data set, and what was measured when by whom."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import acquisition
from acquisition import State, read_status
from calib.errors import DataError
from calib.text import written_by
from drivers.errors import AcquisitionError
from fleet.outbox import Cell, read_data
from fleet.store import Document
from service import refusals
from service.files import as_json

FORMAT = "truepose-campaign-record/1"


def read_record(path: Path, cell: Cell) -> list[Document]:
    """The documents of a record that is finished; none of another. Raises DataError."""
    folder = path.parent
    try:
        status = read_status(folder)
        if status.state != State.SUCCEEDED.value:
            return []
        with TemporaryDirectory(prefix="truepose-fleet-") as place:
            found = read_data(acquisition.export(folder, Path(place) / "data.csv"), cell)
    except DataError as error:  # of a file that nobody sees
        raise DataError(error.what, do=error.do, file=folder, key=error.key) from error
    except AcquisitionError as error:
        raise DataError(refusals.cause(error), do=refusals.remedy(error), file=folder) from error
    summary = {
        "format": FORMAT,
        "program": written_by(),
        "id": status.id,
        "name": status.name,
        "state": status.state,
        "readings": status.done,
        "skipped": status.skipped,
        "simulated": status.simulated,
        "datasets": [each.hash for each in found],
    }
    about = [
        replace(each, kind="campaign", identity=f"campaign {status.id}", content=as_json(summary).encode())
        for each in found
    ]
    return [*found, *about]
