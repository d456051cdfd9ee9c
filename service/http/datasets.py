"""Data sets: uploaded, or exported from a run; `RECORD/datasets/ID/data.csv`, `data.toml`, `about.json`.

A data set is read before it is kept, so everything under `datasets/` can be worked with.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import acquisition
from acquisition import read_status
from acquisition.individuals import Acceptance
from acquisition.merge import export_together
from calib.dataset import read_dataset
from calib.errors import DataError
from calib.files import replace_file
from calib.text_file import decoded
from calib.toml_text import parse_toml
from service import documents
from service.files import as_json
from service.http.bodies import DatasetShown
from service.http.kept import read_kept, readable
from service.http.names import new_id, safe_id
from service.http.problems import not_found
from service.plain import utc_text

CSV, TOML, ABOUT = "data.csv", "data.toml", "about.json"


class Datasets:
    """The data sets of one record directory."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def upload(self, table: bytes, header: bytes, name: str) -> dict[str, Any]:
        """Keep a data set. Raises DataError naming line or key."""
        _refuse_paths(header)

        def write(folder: Path) -> None:
            (folder / CSV).write_bytes(table)
            (folder / TOML).write_bytes(header)

        return self._keep(write, name or "upload", run_id=None)

    def keep(self, data: Path, name: str) -> dict[str, Any]:
        """A copy of a data set that this program has made."""

        def write(folder: Path) -> None:
            shutil.copyfile(data, folder / CSV)
            shutil.copyfile(data.with_suffix(".toml"), folder / TOML)

        return self._keep(write, name, run_id=None)

    def export(
        self, records: Sequence[Path], name: str, accepted: Acceptance | None = None
    ) -> dict[str, Any]:
        """The readings of a run up to now, with those of later runs in the same cell as one data set.

        accepted: another robot than that of the first run. Raises RecordError where there are none, or where they were
        measured in different cells, OtherIndividual.
        """
        first, *later = records

        def write(folder: Path) -> None:
            if later:
                export_together(records, folder / CSV, accepted)
            else:
                acquisition.export(first, folder / CSV)

        return self._keep(write, name or read_status(first).name, run_id=first.name)

    def _keep(self, write: Callable[[Path], object], name: str, *, run_id: str | None) -> dict[str, Any]:
        own = new_id()
        coming = self._folder / f".{own}"  # not yet a data set; ids do not begin with a dot
        coming.mkdir()
        try:
            write(coming)
            about = documents.data_of(read_dataset(coming / CSV))
            document = {
                **about,
                "id": own,
                "name": name,
                "created_utc": utc_text(time.time()),
                "run_id": run_id,
            }
            replace_file(coming / ABOUT, as_json(document))
            coming.rename(self._folder / own)
        except BaseException:
            shutil.rmtree(coming, ignore_errors=True)
            raise
        return document

    def get(self, name: str) -> dict[str, Any]:
        """Raises Problem 404."""
        return read_kept(self.path(name) / ABOUT, DatasetShown)

    def path(self, name: str) -> Path:
        """The folder of a data set. Raises Problem 404."""
        if not safe_id(name) or not (self._folder / name / ABOUT).is_file():
            raise not_found("dataset", name)
        return self._folder / name

    def all(self) -> list[dict[str, Any]]:
        """Newest first."""
        names = sorted((p.name for p in self._folder.iterdir() if safe_id(p.name)), reverse=True)
        return readable(names, self.get)


def _refuse_paths(header: bytes) -> None:
    """A robot given as a path would be looked for among the server's files; built-in ones have names."""
    robot = parse_toml(decoded(header, TOML), TOML).get("robot", "")
    if isinstance(robot, str) and (robot.endswith(".toml") or "/" in robot or "\\" in robot):
        raise DataError("names a file of the server.", do="Name a built-in robot.", file=TOML, key="robot")
