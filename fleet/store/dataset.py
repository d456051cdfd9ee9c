"""A data set as one document (`truepose-fleet-dataset/1`): its table and its header, which are two files, in one."""

from __future__ import annotations

import json

from calib.errors import DataError
from calib.text import parse_json

FORMAT = "truepose-fleet-dataset/1"


def dataset_content(table: str, header: str) -> bytes:
    """The document of a data set. table: text of DATA.csv; header: text of DATA.toml. Same texts, same bytes."""
    return json.dumps({"format": FORMAT, "header": header, "table": table}, ensure_ascii=False).encode()


def dataset_texts(content: bytes) -> tuple[str, str]:
    """The texts of the table and of the header, as they were. Raises DataError if it is no such document."""
    found = parse_json(content, "data set")
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise DataError("is no data set of a store.", do=f'It must hold "format": "{FORMAT}".')
    table, header = found.get("table"), found.get("header")
    if not isinstance(table, str) or not isinstance(header, str):
        raise DataError("has no table or no header.", do="Send the data set again.")
    return table, header
