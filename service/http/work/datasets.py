"""Data sets that were uploaded, or exported from a run.

A data set is in `RECORD/datasets/ID/`, with `data.csv`, `data.toml`, `about.json`.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import acquisition
from acquisition import read_status
from acquisition.record import DeviceAcceptance, export_together
from service.http.wire.bodies import DatasetShown
from service.http.wire.problems import Problem, not_found
from service.http.work.deletions import DeletionLog, take_away
from service.http.work.proposals import Sent, written
from service.http.work.stored_documents import read_kept
from service.ids import plain_name, safe_id
from service.kept_dataset import ABOUT, CSV, TOML, keep_dataset, refuse_path, refuse_paths

MAP = "map.toml"


class DatasetStore:
    """The data sets of one record directory."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def upload(self, table: bytes, header: bytes, name: str) -> dict[str, Any]:
        """Keep a data set.

        Raises
        ------
        DataError
            It cannot be used; the message names line or key.
        """
        refuse_paths(header)

        def write(folder: Path) -> None:
            (folder / CSV).write_bytes(table)
            (folder / TOML).write_bytes(header)

        return keep_dataset(self._folder, write, name or "upload")

    def upload_mapped(self, files: Sent, map_text: bytes, name: str) -> dict[str, Any]:
        """Keep the data set of foreign files (name, content) and their map.

        The document states how the robot fits them and how the files were converted.

        Raises
        ------
        DataError
            As for `truepose convert`.
        """
        # imported in the worker that does it
        from calib.foreign import converted, data_set_of, read_map
        from service.results.files.conversion import MappedFit, remarks_of
        from service.results.shape import document_of

        told: dict[str, Any] = {}

        def write(folder: Path) -> None:
            with written([(MAP, map_text), *files]) as (map_path, *paths):
                made = read_map(map_path)
                refuse_path(made.header.get("robot", ""), MAP)
                found = converted(made, paths, MAP, folder)
                data_set_of(found.table, found.fit, folder / CSV, paths)
            found.table.write(folder / CSV)
            fit = None if found.fit is None else document_of(MappedFit.model_validate(found.fit))
            told.update(fit_of_robot=fit, said=remarks_of(found))

        return keep_dataset(self._folder, write, name or Path(plain_name(files[0][0])).stem) | told

    def keep(self, data: Path, name: str) -> dict[str, Any]:
        """Keep a copy of a data set that this program has made."""

        def write(folder: Path) -> None:
            shutil.copyfile(data, folder / CSV)
            shutil.copyfile(data.with_suffix(".toml"), folder / TOML)

        return keep_dataset(self._folder, write, name)

    def export(
        self, records: Sequence[Path], name: str, accepted: DeviceAcceptance | None = None
    ) -> dict[str, Any]:
        """Export the readings of a run up to now.

        Readings of later runs in the same cell are added to the data set. `accepted` is another robot than that of
        the first run.

        Raises
        ------
        RecordError
            There are no readings, or they were measured in different cells.
        OtherIndividual
            They were measured on another robot that is not accepted.
        """
        first, *later = records

        def write(folder: Path) -> None:
            if later:
                export_together(records, folder / CSV, accepted)
            else:
                acquisition.export(first, folder / CSV)

        return keep_dataset(self._folder, write, name or read_status(first).name, run_id=first.name)

    def get(self, name: str) -> dict[str, Any]:
        """Return the data set of that id.

        Raises
        ------
        Problem
            404: there is no such data set.
        """
        return read_kept(self.path(name) / ABOUT, DatasetShown)

    def path(self, name: str) -> Path:
        """Return the folder of a data set.

        Raises
        ------
        Problem
            404: there is no such data set.
        """
        if not safe_id(name) or not (self._folder / name / ABOUT).is_file():
            raise not_found("dataset", name)
        return self._folder / name

    def delete(self, name: str, trail: DeletionLog, by: str, reason: str) -> dict[str, Any]:
        """Delete a data set and return the line of the trail.

        Raises
        ------
        Problem
            404: there is no such data set.
        StorageError
            The trail cannot be written, or the files cannot be deleted.
        """
        folder = self.path(name)
        try:
            document = self.get(name)
        except Problem:  # damaged
            document = {"id": name}
        line = trail.note("dataset", document, by, reason)
        take_away(folder)
        return line

    def ids(self) -> list[str]:
        """Return the ids of all data sets, newest first."""
        return sorted((p.name for p in self._folder.iterdir() if safe_id(p.name)), reverse=True)
