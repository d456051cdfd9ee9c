"""Stored data set: a folder with `data.csv`, `data.toml` and `about.json`, all or none.

A data set is read before it is stored, so every stored data set is usable.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from calib.data import read_dataset
from calib.errors import DataError
from calib.text import decoded, parse_toml, replace_file
from service.files import as_json
from service.ids import new_id
from service.json_values import utc_text
from service.results.common import DataShown
from service.results.shape import document_of

CSV, TOML, ABOUT = "data.csv", "data.toml", "about.json"


def refuse_paths(header: bytes) -> None:
    """Refuse the header (TOML) of a data set that was sent, if it names the robot by a path.

    The path would otherwise be searched among the files of this computer.

    Raises
    ------
    DataError
        The robot is a path.
    """
    refuse_path(parse_toml(decoded(header, TOML), TOML).get("robot", ""), TOML)


def refuse_path(robot: object, file: str) -> None:
    """Refuse a path in place of the name of a robot.

    Raises
    ------
    DataError
        The robot is a path. The error names `file`.
    """
    if isinstance(robot, str) and (robot.endswith(".toml") or "/" in robot or "\\" in robot):
        raise DataError(
            "names a file, which was not sent with it.",
            do="Name a robot of the library; of one of your own give its name here, and its robot file as the table "
            "[robot_file].",
            file=file,
            key="robot",
        )


def keep_dataset(
    within: Path, write: Callable[[Path], object], name: str, *, run_id: str | None = None
) -> dict[str, Any]:
    """Store a data set in a new folder in `within` and return its description.

    `write` puts the table and the header into the folder. Its errors are passed on; nothing is left behind after an
    error.

    Raises
    ------
    DataError
        The data cannot be used.
    """
    own = new_id()
    coming = within / f".{own}"  # not yet a data set; ids do not begin with a dot
    coming.mkdir()
    try:
        write(coming)
        about = document_of(DataShown.of(read_dataset(coming / CSV)))
        made = utc_text(time.time())
        document = {**about, "id": own, "name": name, "created_utc": made, "run_id": run_id}
        replace_file(coming / ABOUT, as_json(document))
        coming.rename(within / own)
    except BaseException:
        shutil.rmtree(coming, ignore_errors=True)
        raise
    return document
