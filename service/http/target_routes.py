"""Targets corrected with a model that was found: what `truepose compensate` does to a target table."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fastapi import APIRouter

from calib.errors import DataError
from calib.model_file import load_model
from service.http.bodies import CorrectedTargets, TargetsToCorrect
from service.http.campaigns import refuse_untold
from service.http.problems import Problem
from service.http.state import Here
from service.plain import finite
from service.programs import KnownFrames, compensate, named_frames, summary
from service.programs.compensation import REFUSED, Compensation
from service.programs.conditions import stated_conditions
from service.programs.read import parse

router = APIRouter(tags=["results"])
NAME = Path("targets.csv")  # the table as messages call it
ID = "target_id"


@router.post("/models/{job_id}/targets", operation_id="correctTargets", response_model=CorrectedTargets)
def correct_targets(here: Here, job_id: str, body: TargetsToCorrect) -> dict[str, Any]:
    """Correct targets, joint angles or poses, so that the real robot lands where they say.

    422 where one of them cannot be corrected, unless `keep_refused`: then it stays as it was.
    """
    saved = load_model(here.jobs.model_file(job_id))
    refuse_untold(body.targets, "targets")
    text = body.csv or _as_csv(body.targets)
    known = KnownFrames(named_frames("tool", [body.tool] if body.tool else []), {})
    stated = stated_conditions(body.conditions, saved)
    table = parse(text, NAME, saved.model.robot, known)
    done = compensate(table, NAME, saved, stated.stated, known, inverse=body.inverse)
    if not body.keep_refused:
        _refuse(done)
    return finite(
        {
            "format": summary.FORMAT,
            "model": job_id,
            "robot": saved.model.robot.name,
            "direction": "actual to nominal" if body.inverse else "nominal to actual",
            "conditions": stated.document,
            **summary.document(done),
            "warnings": list(stated.notes),
            "csv": done.text,
            "rows": _rows(done.text),
        }
    )


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


def _refuse(done: Compensation) -> None:
    refused = done.of(REFUSED)
    if not refused:
        return
    more = f" and {len(refused) - 1} more" if len(refused) > 1 else ""
    raise Problem(
        422,
        f"Target '{refused[0].target.name}'{more} cannot be corrected: {refused[0].why}.",
        "Change the target, or leave such targets as they are with keep_refused.",
        code=8111,
        targets=[{"target": o.target.name, "line": o.target.line, "reason": o.why} for o in refused],
    )
