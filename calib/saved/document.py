"""Document of an identified model: `truepose-model/1`, or `/2` with carried terms.

It contains

- every parameter with value, standard error, unit, nominal value and owner;
- the effects with their slots and regressors, and the covariance;
- hashes of the data, of the robot and of the whole file;
- the approach and temperature for which the model holds, the held-out error, and that of the robot
  itself if it was verified.

`save_update` writes a model file with updated parameters: the old file with a few new values and their origin. All
other content (data, conditions, held-out error, regression) stays as it was. `updates` lists the changes, oldest first.
`measured` is the date of the readings used for the update.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calib.arm.robot import robot_hash
from calib.array import Array
from calib.diagnose.diagnosis import DiagnosisFit
from calib.fit.identification import IdentificationFit
from calib.fit.statistics import ErrorStatistics
from calib.model.model import ModelStructure
from calib.regression.regression import Regression
from calib.saved.model_checks import content_hash
from calib.saved.regression import document_of
from calib.saved.unresolved_effects import KEY, LeftOpen
from calib.text.json_text import read_json
from calib.text.program import written_by
from calib.text.text_file import replace_file
from calib.units import FACTORS, to_display

FORMAT = "truepose-model/1"
WITH_CARRIED = "truepose-model/2"
"""The format of a model with carried terms: versions that do not know these refuse it, and so do their fleet servers,
which read no effects."""


def model_document(
    identification: IdentificationFit,
    diagnosis: DiagnosisFit | None = None,
    regression: Regression | None = None,
    verified: ErrorStatistics | None = None,
) -> dict[str, Any]:
    """Build the document of a model, with its `content_sha256`.

    `verified` are the errors of the robot at new poses, driven with corrections of this model, mm.
    """
    model = identification.model
    errors = identification.standard_errors
    judged = None if diagnosis is None else diagnosis.error_after
    occasion = identification.header.occasion
    document: dict[str, Any] = {
        "format": WITH_CARRIED if any(e.is_carried for e in model.effects) else FORMAT,
        "program": written_by(),
        "robot": model.robot.name,
        "robot_table": asdict(model.robot),
        "robot_sha256": robot_hash(model.robot),
        "loads": [asdict(load) for load in identification.header.loads],
        "gravity_base": list(identification.header.gravity),
        "joint_coupling": identification.header.coupling,
        "groups": [e.label for e in model.effects if e.group == "base model"],
        "parameters": parameters_of(model, identification.estimate, errors, identification.held_std),
        "dropped": [
            {"name": d.name, "stand_ins": [[name, move] for name, move in d.stand_ins]}
            for d in identification.dropped
        ],
        "effects": [effect.to_json() for effect in model.effects],
        "covariance_internal_units": triangle(identification.covariance),
        "placements": {name: np.asarray(pose).tolist() for name, pose in model.placements.items()},
        "tool_targets_mm": {
            series: {t: list(v) for t, v in own.items()} for series, own in model.targets.items()
        },
        "tool_turns": {name: np.asarray(turn).tolist() for name, turn in model.turns.items()},
        "base_targets_mm": {name: list(place) for name, place in model.anchors.items()},
        "station_mm": list(model.station),
        "data_sha256": identification.data_sha256,
        "simulated": identification.header.simulated,
        "holds_for": scope_of(identification),
        "held_out": None
        if judged is None or diagnosis is None
        else {"kind": diagnosis.dataset.header.holdout, "error_mm": asdict(judged)},
        **({} if verified is None else {"verified": {"error_mm": asdict(verified)}}),
        "noise_scale": identification.noise_scale,
        "degrees_of_freedom": identification.degrees_of_freedom,
        "device": [dict(each) for each in identification.header.devices],
        "measured": None if occasion is None else {"began": occasion.began, "ended": occasion.ended},
    }
    document[KEY] = LeftOpen.of(identification, None if diagnosis is None else diagnosis.held_out).to_json()
    if regression is not None:
        document["regression"] = document_of(regression)
    document["content_sha256"] = content_hash(document)
    return document


def parameters_of(
    model: ModelStructure, estimate: Array, errors: Array, held: Array | None = None
) -> list[dict[str, Any]]:
    """Build the parameter list of a model document.

    Parameters
    ----------
    estimate, errors : array of shape (m,)
        Values and standard errors, internal units.
    held : array of shape (m,), optional
        Standard deviation of each prior in the fit, inf without a prior. None if it is no longer known.
    """
    return [
        {
            "name": parameter.name,
            "value": to_display(float(estimate[i]), parameter.unit),
            "std": to_display(float(errors[i]), parameter.unit),
            "unit": parameter.unit,
            "nominal": _nominal(model, parameter.name),
            "owner": owner,
        }
        | ({} if held is None else {"held_std": _held(float(held[i]), parameter.unit)})
        for i, (parameter, owner) in enumerate((p, e.owner) for e in model.effects for p in e.parameters)
    ]


def _held(std: float, unit: str) -> float | None:
    return to_display(std, unit) if np.isfinite(std) else None


def scope_of(identification: IdentificationFit) -> dict[str, Any]:
    """Describe the conditions of the readings, for which a model holds.

    They are the approach, the temperature, the controller's own correction, and the range of each joint, deg or mm as
    the controller counts.
    """
    conditions = identification.readings.conditions
    robot, coupling = identification.model.robot, identification.header.coupling
    counted = robot.controller_angles(conditions.joints, coupling) / robot.joint_units
    one_sided = [bool(np.all(side == side[0])) for side in conditions.side.T]
    temperature = conditions.temperature[np.isfinite(conditions.temperature)]
    return {
        "approach": [
            ("both sides" if not one else "from below" if side[0] > 0 else "from above")
            for one, side in zip(one_sided, conditions.side.T, strict=True)
        ],
        "temperature_c": float(np.mean(temperature)) if len(temperature) else None,
        "absolute_accuracy": identification.header.absolute_accuracy,
        "joints": [
            [round(low, 3), round(high, 3)]
            for low, high in zip(counted.min(axis=0).tolist(), counted.max(axis=0).tolist(), strict=True)
        ],
    }


def triangle(covariance: Array) -> list[list[float]]:
    """Return the rows of a covariance (m, m) up to the diagonal, to ten digits.

    Curves of gears have a thousand parameters.
    """
    return [[float(f"{x:.10g}") for x in row[: i + 1]] for i, row in enumerate(covariance.tolist())]


def _nominal(model: ModelStructure, name: str) -> float | None:
    """Return the nominal DH number of a geometric parameter in its unit, or None."""
    for kind, values, unit in (
        ("alpha", model.robot.alpha, "deg"),
        ("theta", model.robot.theta, "deg"),
        ("a", model.robot.a, "mm"),
        ("d", model.robot.d, "mm"),
    ):
        if name.startswith(kind) and name[len(kind) :].isdigit():
            return values[int(name[len(kind) :]) - 1] / FACTORS[unit]
    return 0.0 if name.startswith("beta") else None


def save_update(
    path: Path,
    baseline: Path,
    model: ModelStructure,
    estimate: Array,
    covariance: Array,
    update: Mapping[str, Any],
) -> None:
    """Write the model of `baseline` with another estimate and covariance.

    Parameters
    ----------
    model : ModelStructure
        Structure of the baseline, with at most one additional effect.
    estimate, covariance : array of shape (m,) and (m, m)
        New values, internal units.
    update : mapping
        Plain values that describe the change and the readings used.

    Raises
    ------
    DataError
        The baseline cannot be read.
    OSError
        The file cannot be written.
    """
    old = read_json(baseline)
    document = {
        **old,
        "program": written_by(),
        **({"measured": {"began": began, "ended": began}} if (began := update.get("measured")) else {}),
        "parameters": parameters_of(model, estimate, np.sqrt(np.diag(covariance))),
        "effects": [effect.to_json() for effect in model.effects],
        "covariance_internal_units": triangle(covariance),
        "updates": [*old.get("updates", []), {**update, "baseline_sha256": old.get("content_sha256", "")}],
    }
    document["content_sha256"] = content_hash(document)
    replace_file(path, json.dumps(document, indent=1, allow_nan=False) + "\n")
