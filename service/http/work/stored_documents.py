"""Documents that the service keeps as files of the record, read back: whole, or reported as damaged."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from calib.errors import DataError
from calib.text import read_json
from service.http.wire.problems import Problem

DAMAGED = 8501


def read_kept(path: Path, kind: type[BaseModel]) -> dict[str, Any]:
    """The document in a file of the record. Raises Problem 500, saying which, where it is not of this kind."""
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
    """The results of `read` for the names, without those whose file is damaged: one does not take the list down."""
    out = []
    for name in names:
        try:
            out.append(read(name))
        except Problem as problem:
            if problem.code != DAMAGED:
                raise
    return out


def _damaged(path: Path, why: str) -> Problem:
    where = "/".join(path.parts[-3:])
    return Problem(
        500,
        f"The file {where} of the record is damaged ({why.rstrip('.')}).",
        "Restore it from a copy of the record, or remove it; everything else can be used.",
        code=DAMAGED,
    )
