"""`MODEL.json`: an identified model on disk (`truepose-model/1`), complete enough to predict from.

Every parameter with value, standard error, unit, nominal value and owner; the effects with their slots and
regressors; covariance; hash of the data; for which approach and temperature it holds; the held-out error.
A fit that did not converge is refused: nobody should drive a robot with it.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.capsules import Capsule
from calib.diagnose.diagnosis import Diagnosis
from calib.effects.effect import Effect
from calib.errors import DataError
from calib.files import replace_file
from calib.header import Vector
from calib.identification import Identification
from calib.kinematics import Array
from calib.model import RobotModel
from calib.robot import JointMatrix, Load, Robot
from calib.units import FACTORS, to_display, to_internal

FORMAT = "truepose-model/1"


@dataclass(frozen=True)
class SavedModel:
    """A model read back: predict with `Design(model, conditions).predict(estimate)`."""

    model: RobotModel
    estimate: Array
    covariance: Array
    loads: tuple[Load, ...]
    gravity: Vector
    coupling: str
    data_sha256: str
    holds_for: dict[str, Any]


def save_model(path: Path, identification: Identification, diagnosis: Diagnosis | None = None) -> None:
    """Write a model. Raises DataError for a fit that did not converge."""
    if not identification.converged:
        raise DataError(
            "the fit did not converge: it is not saved as a model.", do="Look at its warnings.", file=path
        )
    model = identification.model
    conditions = identification.readings.conditions
    errors = identification.standard_errors
    one_sided = [bool(np.all(side == side[0])) for side in conditions.side.T]
    temperature = conditions.temperature[np.isfinite(conditions.temperature)]
    judged = None if diagnosis is None else diagnosis.error_after
    document = {
        "format": FORMAT,
        "robot": model.robot.name,
        "robot_table": asdict(model.robot),
        "loads": [asdict(load) for load in identification.header.loads],
        "gravity_base": list(identification.header.gravity),
        "joint_coupling": identification.header.coupling,
        "groups": [e.label for e in model.effects if e.group == "base model"],
        "parameters": [
            {
                "name": parameter.name,
                "value": to_display(float(identification.estimate[i]), parameter.unit),
                "std": to_display(float(errors[i]), parameter.unit),
                "unit": parameter.unit,
                "nominal": _nominal(model, parameter.name),
                "owner": owner,
            }
            for i, (parameter, owner) in enumerate((p, e.owner) for e in model.effects for p in e.parameters)
        ],
        "effects": [effect.to_json() for effect in model.effects],
        "covariance_internal_units": identification.covariance.tolist(),
        "placements": {name: np.asarray(pose).tolist() for name, pose in model.placements.items()},
        "tool_targets_mm": {
            series: {t: list(v) for t, v in own.items()} for series, own in model.targets.items()
        },
        "tool_turns": {name: np.asarray(turn).tolist() for name, turn in model.turns.items()},
        "base_targets_mm": {name: list(place) for name, place in model.anchors.items()},
        "station_mm": list(model.station),
        "data_sha256": identification.data_sha256,
        "holds_for": {
            "approach": [
                ("both sides" if not one else "from below" if side[0] > 0 else "from above")
                for one, side in zip(one_sided, conditions.side.T, strict=True)
            ],
            "temperature_c": float(np.mean(temperature)) if len(temperature) else None,
        },
        "held_out": None
        if judged is None or diagnosis is None
        else {"kind": diagnosis.dataset.header.holdout, "error_mm": asdict(judged)},
        "noise_scale": identification.noise_scale,
    }
    replace_file(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


def _nominal(model: RobotModel, name: str) -> float | None:
    """Nominal DH number of a geometric parameter in its unit; None for parameters that have none."""
    for kind, values, unit in (
        ("alpha", model.robot.alpha, "deg"),
        ("theta", model.robot.theta, "deg"),
        ("a", model.robot.a, "mm"),
        ("d", model.robot.d, "mm"),
    ):
        if name.startswith(kind) and name[len(kind) :].isdigit():
            return values[int(name[len(kind) :]) - 1] / FACTORS[unit]
    return 0.0 if name.startswith("beta") else None


def load_model(path: Path) -> SavedModel:
    """Read a model. Raises DataError when the file is not one, or was written for an unknown robot."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(document, dict) or document.get("format") != FORMAT:
            raise DataError("is not a model file.", do=f'It must hold "format": "{FORMAT}".', file=path)
        effects = tuple(Effect.from_json(entry) for entry in document["effects"])
        model = RobotModel(
            robot=_robot(document["robot_table"]),
            effects=effects,
            targets={
                s: {t: tuple(v) for t, v in own.items()} for s, own in document["tool_targets_mm"].items()
            },
            placements={name: np.array(pose) for name, pose in document["placements"].items()},
            station=tuple(document["station_mm"]),
            turns={name: np.array(turn) for name, turn in document.get("tool_turns", {}).items()},
            anchors={name: tuple(place) for name, place in document.get("base_targets_mm", {}).items()},
        )
        values = {
            entry["name"]: to_internal(entry["value"], entry["unit"]) for entry in document["parameters"]
        }
        estimate = np.array([values[p.name] for p in model.parameters])
        covariance = np.array(document["covariance_internal_units"])
        return SavedModel(
            model,
            estimate,
            covariance,
            loads=tuple(_load(load) for load in document["loads"]),
            gravity=tuple(document["gravity_base"]),
            coupling=document["joint_coupling"],
            data_sha256=document["data_sha256"],
            holds_for=document["holds_for"],
        )
    except DataError:
        raise
    except (FileNotFoundError, IsADirectoryError) as error:
        raise DataError("there is no such file.", do="Check the name.", file=path) from error
    except (TypeError, AttributeError) as error:
        raise DataError(
            f"is damaged ({error}).", do="Write the model again with this version.", file=path
        ) from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise DataError(f"is not valid JSON ({error}).", do="Write the model again.", file=path) from error
    except KeyError as error:
        raise DataError(
            "key is missing.",
            do="Write the model again with this version.",
            file=path,
            key=str(error.args[0]),
        ) from error


def _robot(table: dict[str, Any]) -> Robot:
    """The nominal robot as it was when the model was fitted, whatever has become of its file since."""
    matrices = {
        name: JointMatrix(tuple(tuple(row) for row in entry["matrix"]), tuple(entry["offset"]))
        for name, entry in table["joint_matrices"].items()
    }
    plain = {key: tuple(value) if isinstance(value, list) else value for key, value in table.items()}
    loads = tuple(_load(load) for load in table["loads"])
    capsules = tuple(_capsule(capsule) for capsule in table.get("capsules", ()))
    return Robot(**{**plain, "loads": loads, "joint_matrices": matrices, "capsules": capsules})


def _capsule(table: dict[str, Any]) -> Capsule:
    return Capsule(**{**table, "from_mm": tuple(table["from_mm"]), "to_mm": tuple(table["to_mm"])})


def _load(table: dict[str, Any]) -> Load:
    return Load(table["link"], table["mass_kg"], tuple(table["cog_mm"]))
