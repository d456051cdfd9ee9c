"""Documents that the service keeps as files: read completely, or reported as damaged."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from acquisition.errors import RecordError
from calib.errors import DataError
from calib.text import read_json
from service.http.wire.problems import Problem

DAMAGED = 8501


def read_kept(path: Path, kind: type[BaseModel]) -> dict[str, Any]:
    """Read the document in a file of the record.

    Raises
    ------
    Problem
        500 if the document is not of this kind. The message names the file.
    """
    try:
        document = read_json(path)
        kind.model_validate(document)
    except DataError as error:
        raise _damaged(path, error.what) from error
    except ValidationError as error:
        first = error.errors()[0]
        raise _damaged(path, f"{'.'.join(map(str, first['loc'])) or 'it'}: {first['msg']}") from error
    return document


def readable(names: Iterable[str], read: Callable[[str], dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the results of `read` for the names, without those that are damaged or gone.

    One damaged file, or one that is being made or deleted, therefore does not make the list fail.
    """
    out = []
    for name in names:
        try:
            out.append(read(name))
        except Problem as problem:
            if problem.code != DAMAGED and problem.status_code != 404:
                raise
        except RecordError:
            continue  # a folder without a record
    return out


def _damaged(path: Path, why: str) -> Problem:
    where = "/".join(path.parts[-3:])
    return Problem(
        500,
        f"The file {where} of the record is damaged ({why.rstrip('.')}).",
        "Restore it from a copy of the record, or remove it; all other files of the record can be used.",
        code=DAMAGED,
    )
