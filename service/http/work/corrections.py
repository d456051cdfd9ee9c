"""Correcting the targets of a request with a model that was found; called in a worker process."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from calib.compensate import Bounds
from calib.errors import DataError
from calib.saved import load_model
from service.http.work.campaigns import refuse_null
from service.plain import finite
from service.programs import KnownFrames, compensate, named_frames, summary
from service.programs.compensation import REFUSED
from service.programs.conditions import stated_conditions
from service.programs.read import parse

NAME = Path("targets.csv")  # the table as messages call it
ID = "target_id"


def corrected(
    model_file: Path, model_id: str, order: Mapping[str, Any]
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The document of the answer, and the targets that cannot be corrected. `order`: as `TargetsToCorrect`.

    Raises DataError, ConfigError.
    """
    saved = load_model(model_file, bounds=Bounds(order["largest_deg"], order["largest_mm"]))
    refuse_null(order["targets"], "targets")
    text = order["csv"] or _as_csv(order["targets"])
    known = KnownFrames(named_frames("tool", [order["tool"]] if order["tool"] else []), {})
    stated = stated_conditions(order["conditions"], saved)
    table = parse(text, NAME, saved.model.robot, known)
    done = compensate(table, NAME, saved, stated.stated, known, inverse=order["inverse"])
    document = finite(
        {
            "format": summary.FORMAT,
            "model": model_id,
            "robot": saved.model.robot.name,
            "direction": "actual to nominal" if order["inverse"] else "nominal to actual",
            "conditions": stated.document,
            **summary.document(done),
            "warnings": list(stated.notes),
            "csv": done.text,
            "rows": _rows(done.text),
        }
    )
    refused = [
        {"target": each.target.name, "line": each.target.line, "reason": each.why}
        for each in done.of(REFUSED)
    ]
    return document, refused


def _as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows as a table; what a row does not have is empty."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    if ID not in names:
        raise DataError(f"has no '{ID}'.", do="Give every target an id.", key="targets")
    out = io.StringIO(newline="")
    writer = csv.DictWriter(out, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def _rows(text: str) -> list[dict[str, Any]]:
    """Its rows, numbers as numbers; ids and configurations stay text."""
    return [
        {name: _value(name, cell) for name, cell in row.items() if name is not None}
        for row in csv.DictReader(io.StringIO(text))
    ]


def _value(name: str, cell: str) -> float | str:
    try:
        return cell if name == ID else float(cell)
    except (TypeError, ValueError):
        return cell
