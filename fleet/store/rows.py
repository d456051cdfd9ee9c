"""The statements of a document as rows: model parameters, verdicts and causes.

Verdicts and causes come from a watch or a diagnosis. Only these values are read; the document itself is kept whole. A
data set has no rows: it is data.

A data set is one document (`truepose-fleet-dataset/1`) with its table and its header, which are two files.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from calib.errors import DataError
from calib.text import parse_json
from fleet.store.document import Document, Kind

FORMAT = "truepose-fleet-dataset/1"

FORMATS: dict[Kind, str] = {
    "model": "truepose-model/1",
    "watch": "truepose-watch/1",
    "diagnosis": "truepose-diagnosis/1",
    "thermal": "truepose-upkeep/1",
    "retired": "truepose-retired/1",
    "dataset": FORMAT,
}
"""What a document of a kind must be; the other kinds may be any JSON with a format."""

_ALSO = (("model", "truepose-model/2"),)  # a model with carried terms
K = 2.0  # coverage factor of U
ERROR = "error_rms"
"""The name under which the position error is kept among the parameters: of a model on readings that it had not seen, of
a watch at its check poses; RMS, mm."""

_TEXT = 2000  # letters kept of a sentence


@dataclass(frozen=True)
class Rows:
    """The rows of one document, without its number in the store."""

    program: str = ""
    parameters: tuple[dict[str, Any], ...] = ()  # name, value, u, unit
    verdict: dict[str, Any] | None = None  # verdict, in_words, advice
    causes: tuple[dict[str, Any], ...] = ()  # rank, label, in_words, weight, value, u, unit


def rows_of(document: Document) -> Rows:
    """Return the rows of a document.

    Raises
    ------
    DataError
        The content is not of its kind; the error names its key.
    """
    place = f"{document.kind} {document.identity}"
    table = parse_json(document.content, place)
    wanted = FORMATS.get(document.kind)
    if not isinstance(table, dict) or not isinstance(table.get("format"), str):
        raise DataError(
            "is not a document of this program.", do="Send the file as it was written.", file=place
        )
    if wanted is not None and table["format"] != wanted and (document.kind, table["format"]) not in _ALSO:
        raise DataError(
            f"is {table['format']!r}.",
            do=f"Send a document of the format '{wanted}'; one of a newer version needs a newer store.",
            file=place,
            key="format",
        )
    try:
        return _rows(document.kind, table)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DataError(
            f"is damaged ({type(error).__name__}: {error}).",
            do="Send the file as it was written.",
            file=place,
        ) from error


def _rows(kind: Kind, table: Mapping[str, Any]) -> Rows:
    program = _text(table.get("program", ""))
    if kind == "model":
        # two halves of the same readings carry different terms: their sizes are no trend
        carried = {
            p["name"] for e in table.get("effects", []) if e["group"] == "carried" for p in e["parameters"]
        }
        named = (_parameter(each) for each in table["parameters"] if each["name"] not in carried)
        return Rows(program, (*named, *_held_out(table)))
    if kind == "watch":
        said = {name: _text(table[name]) for name in ("verdict", "in_words", "advice")}
        causes = enumerate(table["causes"], start=1)
        return Rows(program, _missed(table), said, tuple(_cause(rank, each) for rank, each in causes))
    if kind == "thermal":
        return _thermal(program, table)
    if kind == "retired":
        return Rows(program, (), {"verdict": kind, "in_words": _text(table["because"]), "advice": ""})
    if kind == "diagnosis":
        said = {"verdict": _text(table["verdict"]), "in_words": "", "advice": ""}
        effects = enumerate(table["effects"], start=1)
        return Rows(program, (), said, tuple(_effect(rank, each) for rank, each in effects))
    return Rows(program)


def _parameter(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return a parameter with its standard error `std`, or with U if `u` is given."""
    value = _number(entry["value"])
    if value is None:
        raise ValueError(f"{entry['name']} has no value")
    if "u" in entry:
        u = _number(entry["u"])
    else:
        std = _number(entry["std"])
        u = None if std is None else K * std
    return {"name": _text(entry["name"]), "value": value, "u": u, "unit": _text(entry["unit"])}


def _thermal(program: str, table: Mapping[str, Any]) -> Rows:
    """Return the rows of a thermal update: its parameters, or the causes if it was not thermal."""
    thermal = table["thermal"]
    said = {"verdict": "thermal" if thermal else "not thermal"}
    said |= {name: _text(table[name]) for name in ("in_words", "advice")}
    parameters = tuple(_parameter(each) for each in (table["parameters"] if thermal else ()))
    causes = tuple(
        {
            "rank": rank,
            "label": _text(label),
            "in_words": "",
            "weight": None,
            "value": None,
            "u": None,
            "unit": "",
        }
        for rank, label in enumerate(table["instead"], start=1)
    )
    return Rows(program, parameters, said, causes)


def _held_out(table: Mapping[str, Any]) -> tuple[dict[str, Any], ...]:
    """Return the error on held-out readings, if any, unless a watch has changed the model since.

    Its U is that of an RMS over n errors with three coordinates each.
    """
    judged = table.get("held_out")
    if judged is None or table.get("updates"):
        return ()
    rms, n = _number(judged["error_mm"]["rms"]), judged["error_mm"]["n"]
    return () if rms is None else (_error(rms, K * rms / math.sqrt(6.0 * n)),)


def _missed(table: Mapping[str, Any]) -> tuple[dict[str, Any], ...]:
    """Return the error at the check poses; watches of older versions have none."""
    found = table.get("error_mm")
    rms, u = (None, None) if found is None else (_number(found["rms"]), _number(found["u"]))
    return () if rms is None else (_error(rms, u),)


def _error(rms: float, u: float | None) -> dict[str, Any]:
    return {"name": ERROR, "value": rms, "u": u, "unit": "mm"}


def _cause(rank: int, entry: Mapping[str, Any]) -> dict[str, Any]:
    size = entry["size"]
    return {
        "rank": rank,
        "label": _text(entry["label"]),
        "in_words": _text(entry["in_words"]),
        "weight": _number(entry["weight"]),
        "value": _number(size["value"]),
        "u": _number(size["u"]),
        "unit": _text(size["unit"]),
    }


def _effect(rank: int, entry: Mapping[str, Any]) -> dict[str, Any]:
    label, size = _text(entry["label"]), entry["amplitude"]
    std = _number(size["std"])
    return {
        "rank": rank,
        "label": label,
        "in_words": _text(entry["meaning"]),
        "weight": _number(entry["candidates"].get(label)),
        "value": _number(size["value"]),
        "u": None if std is None else K * std,
        "unit": _text(size["unit"]),
    }


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is not text")
    value.encode()  # JSON may hold half a letter, which no database takes
    return value.replace("\0", " ")[:_TEXT]


def _number(value: Any) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise TypeError(f"{value!r} is not a number")
    return float(value)


def dataset_content(table: str, header: str) -> bytes:
    """Return the document of a data set from the texts of DATA.csv and DATA.toml.

    Equal texts give equal bytes.
    """
    return json.dumps({"format": FORMAT, "header": header, "table": table}, ensure_ascii=False).encode()


def dataset_texts(content: bytes) -> tuple[str, str]:
    """Return the texts of the table and of the header, as they were.

    Raises
    ------
    DataError
        The content is not such a document.
    """
    found = parse_json(content, "data set")
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise DataError("is not a data set of a store.", do=f'It must hold "format": "{FORMAT}".')
    table, header = found.get("table"), found.get("header")
    if not isinstance(table, str) or not isinstance(header, str):
        raise DataError("has no table or no header.", do="Send the data set again.")
    return table, header
