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
from calib.text import replace_file
from service.files import as_json
from service.names import new_id
from service.plain import utc_text
from service.results.models import documents

CSV, TOML, ABOUT = "data.csv", "data.toml", "about.json"


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
        about = documents.data_of(read_dataset(coming / CSV))
        made = utc_text(time.time())
        document = {**about, "id": own, "name": name, "created_utc": made, "run_id": run_id}
        replace_file(coming / ABOUT, as_json(document))
        coming.rename(within / own)
    except BaseException:
        shutil.rmtree(coming, ignore_errors=True)
        raise
    return document
