"""The statement kept of one diagnosis: `truepose-fleet-diagnosis/1`, or a refusal.

It has about 5 kB. Data that cannot be used are refused. Values are in the units of files and screens; null stands for
missing values.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from calib.diagnose import DiagnosedEffect, DiagnosisFit
from calib.errors import DataError
from calib.fit import ErrorStatistics
from calib.saved import parameters_of
from fleet.store.rediagnosed import FORMAT

REFUSED = "refused"
"""The verdict of a data set that cannot be used."""


def of_diagnosis(name: str, found: DiagnosisFit) -> dict[str, Any]:
    """Return verdict, effects and errors on held-out readings (mm) of a data set."""
    data = found.dataset
    return {
        "format": FORMAT,
        "name": name,
        "robot": data.header.robot.name,
        "simulated": data.header.simulated,
        "readings": int(data.fit_rows.sum()),
        "held_out": int(data.validation_rows.sum()),
        "verdict": found.verdict,
        "effects": [_effect(each) for each in found.effects],
        "error_nominal_mm": _errors(found.error_nominal),
        "error_before_mm": _errors(found.error_before),
        "error_after_mm": _errors(found.error_after),
        "parameters": _parameters(found) if found.final.converged else [],
        "structure": [each.where for each in found.structure],
        "converged": bool(found.final.converged),
    }


def of_refusal(name: str, error: DataError) -> dict[str, Any]:
    """Return the fault of a data set and its remedy, with line and key if known.

    It has no path, because the file may have been in a temporary folder.
    """
    return {
        "format": FORMAT,
        "name": name,
        "verdict": REFUSED,
        "what": error.what,
        "do": error.do,
        "line": error.line,
        "key": error.key,
    }


def _parameters(found: DiagnosisFit) -> list[dict[str, Any]]:
    """Return the parameters of the base model and of identified effects, as trends use them."""
    final = found.final
    carried = {p.name for e in final.model.effects if e.is_carried for p in e.parameters}
    entries = parameters_of(final.model, final.estimate, final.standard_errors)
    return [
        {"name": e["name"], "value": _short(e["value"]), "std": _short(e["std"]), "unit": e["unit"]}
        for e in entries
        if e["name"] not in carried
    ]


def _short(value: float) -> float | None:
    """Round numbers to nine digits, because a hundred thousand of these tables are kept."""
    return float(f"{value:.9g}") if math.isfinite(value) else None


def _effect(found: DiagnosedEffect) -> dict[str, Any]:
    value, std, unit = found.effect.amplitude(found.values, found.covariance)
    return {
        "label": found.effect.label,
        "value": _number(value),
        "std": _number(std),
        "unit": unit,
        "p_value": _number(found.evidence.p_value),
        "rivals": [label for label in found.evidence.candidates if label != found.effect.label],
    }


def _errors(errors: ErrorStatistics | None) -> Mapping[str, float | int | None] | None:
    if errors is None:
        return None
    return {"n": errors.n, **{key: _number(getattr(errors, key)) for key in ("rms", "p95", "max")}}


def _number(value: float) -> float | None:
    """Return None for NaN and infinity, which JSON does not have."""
    return float(value) if math.isfinite(value) else None
