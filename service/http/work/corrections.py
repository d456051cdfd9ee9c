"""Correction of the targets, or the program, of a request with an identified model.

A model can also be written in another program's format. The functions are called in a worker process.
"""

from __future__ import annotations

import base64
import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from calib.compensate import Bounds, Usable
from calib.errors import DataError
from calib.saved import CalibratedModel, load_model
from calib.text import meant_by
from service.exports import listed, written
from service.http.work.campaigns import refuse_null
from service.json_values import finite
from service.programs import Compensation, KnownFrames, compensate, compensation, named_frames, pulses_of
from service.programs.compensation import REFUSED
from service.programs.conditions import ProgramConditions, stated_conditions
from service.programs.program import RobotProgram
from service.programs.read import parse
from service.programs.text import bytes_of, text_of
from service.results.shape import document_of

NAME = Path("targets.csv")  # the table as messages call it
ID = "target_id"


def corrected(
    model_file: Path, model_id: str, order: Mapping[str, Any]
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the document of the answer, and the targets that cannot be corrected.

    `order` is a dict of `TargetsToCorrect`.

    Raises
    ------
    DataError, ConfigError
        The model, the targets or the conditions cannot be used.
    """
    saved, usable = for_use(model_file, order)
    refuse_null(order["targets"], "targets")
    text = order["csv"] or _as_csv(order["targets"])
    known = KnownFrames(named_frames("tool", [order["tool"]] if order["tool"] else []), {})
    stated = stated_conditions(order["conditions"], saved)
    table = parse(text, NAME, saved.model.robot, known)
    done = _compensated(table, NAME, saved, stated, known, order)
    more = {"csv": done.text, "rows": _rows(done.text)}
    return finite(_told(done, saved, usable, model_id, stated, order) | more), _refused(done)


def corrected_program(
    model_file: Path, model_id: str, name: str, content: bytes, order: Mapping[str, Any]
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Correct a program of this name and content.

    The result is that of `corrected`; `order` is the form of the request.

    Raises
    ------
    DataError
        The model, the program or the conditions cannot be used.
    """
    saved, usable = for_use(model_file, order)
    file = Path(name)
    known = KnownFrames(
        named_frames("tool", order["tool"]),
        named_frames("frame", order["frame"]),
        pulses_of("pulses", order["pulses"]),
        order["external_apart"],
    )
    stated = stated_conditions(order["conditions"], saved)
    program = parse(text_of(content, file), file, saved.model.robot, known)
    done = _compensated(program, file, saved, stated, known, order)
    more = {"name": name, "program_base64": base64.b64encode(bytes_of(done.text)).decode("ascii")}
    return _sayable(finite(_told(done, saved, usable, model_id, stated, order) | more)), _sayable(
        _refused(done)
    )


def _compensated(
    program: RobotProgram,
    file: Path,
    saved: CalibratedModel,
    stated: ProgramConditions,
    known: KnownFrames,
    order: Mapping[str, Any],
) -> Compensation:
    most = order["most_uncertainty_mm"] or math.inf
    return compensate(program, file, saved, stated.stated, known, inverse=order["inverse"], most_mm=most)


def for_use(model_file: Path, order: Mapping[str, Any]) -> tuple[CalibratedModel, Usable]:
    """Return the model of a request for corrections, and the parts of it that are left out.

    Raises
    ------
    DataError
        The model cannot be used.
    """
    bounds = Bounds(order["largest_deg"], order["largest_mm"])
    return load_model(model_file, bounds=bounds).for_use(named_only=order["named_only"], bounds=bounds)


def _told(
    done: Compensation,
    saved: CalibratedModel,
    usable: Usable,
    model_id: str,
    stated: ProgramConditions,
    order: Mapping[str, Any],
) -> dict[str, Any]:
    return {
        "format": compensation.FORMAT,
        "model": model_id,
        "robot": saved.model.robot.name,
        "direction": "actual to nominal" if order["inverse"] else "nominal to actual",
        "conditions": stated.document,
        **compensation.document(done),
        **compensation.of_carried(usable),
        "warnings": list(stated.notes),
    }


def _refused(done: Compensation) -> list[dict[str, Any]]:
    return [
        {"target": each.target.name, "line": each.target.line, "reason": each.why}
        for each in done.of(REFUSED)
    ]


def _sayable(value: Any) -> Any:
    """Replace bytes of a program that are not UTF-8 by `?`, because JSON cannot hold them."""
    if isinstance(value, str):
        return value.encode("utf-8", errors="replace").decode("utf-8")
    if isinstance(value, Mapping):
        return {key: _sayable(each) for key, each in value.items()}
    return [_sayable(each) for each in value] if isinstance(value, list) else value


def _as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Write rows as a table; missing values are empty."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    if ID not in names:
        raise DataError(f"has no '{ID}'.", do="Give every target an id.", key="targets")
    out = io.StringIO(newline="")
    writer = csv.DictWriter(out, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def _rows(text: str) -> list[dict[str, Any]]:
    """Return the rows of a table, numbers as numbers; ids and configurations stay text."""
    return [
        {name: _value(name, cell) for name, cell in row.items() if name is not None}
        for row in csv.DictReader(io.StringIO(text))
    ]


def _value(name: str, cell: str) -> float | str:
    try:
        return meant_by(cell) if name == ID else float(cell)
    except ValueError:
        return meant_by(cell)
    except TypeError:  # a row that is shorter than the header
        return cell


def _proven(model_file: Path, order: Mapping[str, Any]) -> tuple[CalibratedModel, Usable]:
    """Return the result of `for_use`, with the error of a verification if the file has none."""
    saved, usable = for_use(model_file, order)
    if saved.verified_rms_mm is None:
        saved = replace(saved, verified_rms_mm=order["verified_rms_mm"])
    return saved, usable


def exported(model_file: Path, model_id: str, kind: str, order: Mapping[str, Any]) -> dict[str, Any]:
    """Return the document of the answer; `order` is the query of the request.

    Raises
    ------
    DataError
        The model cannot be written in this format.
    """
    saved, usable = _proven(model_file, order)
    done = written(saved, usable, model_id, kind, order["conditions"], order["robot_hash"] or None)
    return finite(done.document | {"text": done.text, "about": list(done.about)})


def exports_listed(model_file: Path, model_id: str, order: Mapping[str, Any]) -> dict[str, Any]:
    """Return what every format of an export leaves; `order` is the query of the request.

    Raises
    ------
    DataError
        No format can hold the model.
    """
    saved, usable = _proven(model_file, order)
    return finite(document_of(listed(saved, usable, model_id, order["conditions"])))
