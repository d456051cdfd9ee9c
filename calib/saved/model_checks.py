"""Checks of a model file before anything is predicted or corrected with it.

A file may have been damaged, edited by hand, or made for another robot. If a joint turns by 23 deg because a parameter
is in the file twice, the numbers alone do not show it. Each refusal names the fault.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, get_args

import numpy as np

from calib.arm.kinematics import BESIDE, Chain
from calib.arm.robot import DESCRIPTION, Robot
from calib.array import Array
from calib.errors import DataError
from calib.fit.least_squares import DroppedParameter
from calib.model.carried_regressors import LAWS, QUANTITIES, Held, HeldPair, OfTime
from calib.model.effect import Group, Owner
from calib.model.model import ModelStructure
from calib.text.toml_table import FARTHEST_MM
from calib.units import FACTORS, to_internal

_WRITE_AGAIN = "Write the model again with 'truepose diagnose DATA.csv --model'."
_SAME = 1e-9  # rad and mm
_SHAPES = {
    "joint": int,
    "count": int,
    "other": int,
    "quantity": str,
    "law": str,
    "axis": int,
    "order": (int, float),
    "series": str,
    "target": str,
    "anchor": str,
}


def content_hash(document: Mapping[str, Any]) -> str:
    """Hash a document without its own `content_sha256` (SHA-256).

    Indentation and order do not matter.
    """
    rest = {key: value for key, value in document.items() if key != "content_sha256"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def refuse_changed(document: Mapping[str, Any], path: Path) -> tuple[str, ...]:
    """Refuse a document that was changed after it was written.

    Returns
    -------
    tuple of str
        A remark if the document has no hash.

    Raises
    ------
    DataError
        The contents do not have the stated hash.
    """
    written = document.get("content_sha256")
    if written is None:
        return (
            f"{path.name} was written by an older version without a hash: a change to it is not noticed.",
        )
    if written != content_hash(document):
        raise DataError(
            "was changed after it was written: its content does not have the hash that it states.",
            do=_WRITE_AGAIN,
            file=path,
            key="content_sha256",
        )
    return ()


def refuse_other_table(robot: Robot, reference: Robot, path: Path) -> None:
    """Refuse a model whose robot is not the one of the robot file.

    Raises
    ------
    DataError
        The tables differ; the message names the first difference.
    """
    own, other = asdict(robot), asdict(reference)
    if reference.loads_estimated:
        own["loads"], own["loads_estimated"] = other["loads"], True
    for key, value in own.items():
        if key not in DESCRIPTION and not _same(value, other[key]):
            where = key
            if key in ("lower", "upper") and len(robot.lower) == len(reference.lower):
                k = next(k for k, pair in enumerate(zip(value, other[key], strict=True)) if not _same(*pair))
                unit, factor, axis = robot.units[k], robot.joint_units[k], robot.axes[k].removeprefix("j")
                limits = f"{value[k] / factor:g} {unit}, in the robot file {other[key][k] / factor:g} {unit}"
                where = f"the {key} limit of joint {axis} is {limits}"
            raise DataError(
                f"its robot is not '{reference.name}' as the robot file has it: {where}.",
                do="Use the model of this robot, or give the robot's own file with --robot FILE.toml.",
                file=path,
                key=f"robot_table.{key}",
            )


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(_same(a, b) for a, b in zip(one, other, strict=True))
    if isinstance(one, float | int) and isinstance(other, float | int):
        return abs(one - other) <= _SAME
    return bool(one == other)


def refuse_effects(model: ModelStructure, path: Path) -> None:
    """Refuse an effect that acts on nothing, or whose shape does not exist on the robot.

    Raises
    ------
    DataError
        An effect is invalid; the message names it.
    """
    slots = {*Chain.of(model.robot).slots, *BESIDE}
    names: set[str] = set()
    for effect in model.effects:

        def refuse(what: str, label: object = effect.label) -> DataError:
            return DataError(f"effect {label!r} {what}.", do=_WRITE_AGAIN, file=path, key="effects")

        if not all(isinstance(word, str) for word in (effect.label, effect.meaning)):
            raise refuse("has a label or meaning that is no text")
        if effect.owner not in get_args(Owner) or effect.group not in get_args(Group):
            raise refuse(f"belongs to {effect.owner!r}, {effect.group!r}")
        if not all(isinstance(value, int | float | str) for value in effect.shape.values()):
            raise refuse("has a shape that is no number")
        own = set()
        for parameter in effect.parameters:
            size = parameter.size
            if not isinstance(parameter.name, str) or parameter.name in names:
                raise refuse(f"has a parameter {parameter.name!r} that is given twice or has no name")
            if not isinstance(parameter.unit, str) or parameter.unit not in FACTORS:
                raise refuse(f"has a parameter {parameter.name!r} in the unit {parameter.unit!r}")
            if effect.is_carried and size is None:
                raise refuse(f"has a parameter {parameter.name!r} without a size")
            if size is not None and not (_is_number(size) and size > 0.0):
                raise refuse(f"has a parameter {parameter.name!r} of the size {size!r}")
            if parameter.centre is not None and not _is_number(parameter.centre):
                raise refuse(f"has a parameter {parameter.name!r} about {parameter.centre!r}")
            own.add(parameter.name)
            names.add(parameter.name)
        for term in effect.terms:
            if term.parameter not in own or term.slot not in slots or not _is_number(term.weight):
                raise refuse(f"has a term of {term.parameter!r} on {term.slot!r}, weight {term.weight!r}")
            _refuse_regressor(term.regressor, model, refuse)


def _refuse_regressor(regressor: Any, model: ModelStructure, refuse: Any) -> None:
    if isinstance(regressor, Held | HeldPair):
        good = regressor.law in LAWS and (isinstance(regressor, HeldPair) or regressor.quantity in QUANTITIES)
        if not good or (regressor.joint == 0 and getattr(regressor, "quantity", "") != "air"):
            raise refuse(f"has {type(regressor).__name__} with an unknown quantity, law or joint")
    elif isinstance(regressor, OfTime):
        _refuse_function(regressor, refuse)
        return
    for field in fields(regressor):
        value = getattr(regressor, field.name)
        kind = _SHAPES.get(field.name, (int, float))
        good = isinstance(value, kind) and not isinstance(value, bool)
        if good and isinstance(value, float):
            good = bool(np.isfinite(value))
        if good and field.name in ("joint", "other"):
            air = getattr(regressor, "quantity", "") == "air"
            good = value == 0 if air else 1 <= value <= model.robot.joints
        elif good and field.name == "axis":
            good = 0 <= value <= 2
        elif good and field.name == "high":
            good = value > regressor.low
        elif good and isinstance(regressor, HeldPair) and field.name == "other_high":
            good = value > regressor.other_low
        elif good and field.name in ("width", "time_constant_s", "count"):
            good = value > 0.0
        elif good and field.name == "series":
            good = value in model.targets
        elif good and field.name == "target":
            good = any(value in targets for targets in model.targets.values())
        elif good and field.name == "anchor":
            good = value in model.anchors
        if not good:
            raise refuse(f"has {type(regressor).__name__} of {field.name} = {value!r}")


def _refuse_function(regressor: OfTime, refuse: Any) -> None:
    times, values = regressor.times, regressor.values
    good = (
        regressor.clock in ("time", "order")
        and isinstance(times, tuple)
        and isinstance(values, tuple)
        and 2 <= len(times) == len(values)
        and all(_is_number(x) for x in (*times, *values))
    )
    if not good or np.any(np.diff(times) <= 0.0):
        raise refuse("has OfTime without increasing times and as many numbers")


def estimate_of(entries: Any, model: ModelStructure, path: Path) -> Array:
    """Read the values (m,) of the parameters, internal units.

    Raises
    ------
    DataError
        A parameter is missing, unknown, or given twice.
    """
    values: dict[str, float] = {}
    for entry in entries:
        name, value = entry["name"], entry["value"]
        position = model.index.get(name) if isinstance(name, str) else None
        if position is None:
            what = "is not a parameter of the model's effects."
        elif name in values:
            what = "is given twice."
        elif entry["unit"] != model.parameters[position].unit:
            what = f"is in {entry['unit']!r}, its effect in {model.parameters[position].unit!r}."
        elif not _is_number(value):
            what = f"is {value!r}, but a number is needed."
        else:
            values[name] = to_internal(float(value), entry["unit"])
            continue
        raise DataError(what, do=_WRITE_AGAIN, file=path, key=f"parameters.{name}")
    for name in model.index:
        if name not in values:
            raise DataError("is missing.", do=_WRITE_AGAIN, file=path, key=f"parameters.{name}")
    return np.array([values[name] for name in model.index])


def held_std_of(entries: Any, model: ModelStructure, path: Path) -> Array | None:
    """Read the standard deviation (m,) of every parameter's prior in the fit, internal units.

    It is inf without a prior. The result is None if the file does not state them: older versions did not, and a model
    that a watch updated no longer knows them.

    Raises
    ------
    DataError
        A value is invalid.
    """
    held = {entry["name"]: entry.get("held_std") for entry in entries if "held_std" in entry}
    if len(held) < len(model.parameters):
        return None
    out = np.full(len(model.parameters), np.inf)
    for i, p in enumerate(model.parameters):
        std = held[p.name]
        if std is not None and not (_is_number(std) and std > 0.0):
            raise DataError(f"is {std!r}.", do=_WRITE_AGAIN, file=path, key=f"parameters.{p.name}.held_std")
        out[i] = np.inf if std is None else to_internal(float(std), p.unit)
    return out


def dropped_of(entries: Any, path: Path) -> tuple[DroppedParameter, ...]:
    """Read the parameters that the readings did not determine, and those that replace them.

    Raises
    ------
    DataError
        An entry is invalid.
    """
    out = []
    for entry in entries:
        name, stand_ins = entry["name"], tuple((other, move) for other, move in entry["stand_ins"])
        if not isinstance(name, str) or not all(isinstance(o, str) and _is_number(m) for o, m in stand_ins):
            raise DataError(f"is {entry!r}.", do=_WRITE_AGAIN, file=path, key="dropped")
        out.append(DroppedParameter(name, tuple(other for other, _ in stand_ins), stand_ins))
    return tuple(out)


def numbers_of(value: Any, shape: Sequence[int], key: str, path: Path, most: float = np.inf) -> Array:
    """Read an array of finite numbers of a given shape, none beyond `most`.

    Raises
    ------
    DataError
        The numbers are invalid; the message names the key.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.array(np.nan)
    if array.shape != tuple(shape) or not np.all(np.abs(array) <= most) or not np.all(np.isfinite(array)):
        wanted = " x ".join(map(str, shape))
        raise DataError(f"is not {wanted} possible numbers.", do=_WRITE_AGAIN, file=path, key=key)
    return array


def rigid(value: Any, size: int, key: str, path: Path) -> Array:
    """Read a rotation (3, 3) or a pose (4, 4), mm.

    Raises
    ------
    DataError
        The numbers are invalid; the message names the key.
    """
    array = numbers_of(value, (size, size), key, path, FARTHEST_MM)
    turn = array[:3, :3]
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turn) < 0.0:
        raise DataError("does not hold a rotation.", do=_WRITE_AGAIN, file=path, key=key)
    if size == 4 and np.abs(array[3] - (0.0, 0.0, 0.0, 1.0)).max() > 1e-9:
        raise DataError("does not hold a pose.", do=_WRITE_AGAIN, file=path, key=key)
    return array


def covariance_of(value: Any, count: int, path: Path) -> Array:
    """Read a covariance (m, m), internal units.

    The file contains its rows up to the diagonal, or whole rows in older files.

    Raises
    ------
    DataError
        The numbers are no covariance.
    """
    key = "covariance_internal_units"
    if isinstance(value, list) and [len(r) if isinstance(r, list) else 0 for r in value] == [
        *range(1, count + 1)
    ]:
        value = [[*row, *(0.0,) * (count - len(row))] for row in value]
        array = numbers_of(value, (count, count), key, path)
        array = array + np.tril(array, -1).T
    else:
        array = numbers_of(value, (count, count), key, path)
    spread = np.sqrt(np.maximum(np.diag(array), 0.0))
    if np.any(np.diag(array) < 0.0) or np.any(np.abs(array) > 1.001 * np.outer(spread, spread) + 1e-30):
        raise DataError("is not a covariance matrix.", do=_WRITE_AGAIN, file=path, key=key)
    return array


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
