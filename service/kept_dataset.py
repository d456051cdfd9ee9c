"""A data set that is kept: a folder with `data.csv`, `data.toml` and `about.json`, whole or not at all.

It is read before it is kept, so everything that is kept can be worked with.
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
    """Refuse the header (TOML) of a data set that was sent, where its robot is a path: it would be looked for among
    the files of this computer. Raises DataError."""
    refuse_path(parse_toml(decoded(header, TOML), TOML).get("robot", ""), TOML)


def refuse_path(robot: object, file: str) -> None:
    """Refuse a path where the name of a robot is wanted. Raises DataError naming the file."""
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
    """A new folder in `within`, into which `write` puts table and header; what is said of the data set.

    Raises DataError for data that cannot be used, and what `write` raises; nothing is left behind then.
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
