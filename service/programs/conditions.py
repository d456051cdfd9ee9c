"""Conditions for which a correction must hold: `--conditions side=...,temperature=...`.

    side=below | above | +1 | -1, for all joints or one for each with ':' between, as the controller counts
    approach=5         how far before the target the last move begins, deg
    temperature=23.5   air, degC;   time=3600   s since the start of the campaign
    mass=2.7   cog=50:25:100   the tool on the last link, kg and mm, instead of the load of the data set
    series=NAME        which set-up of base and tool
    absolute-accuracy=on | off   whether the controller that runs the program corrects by its maker's calibration

Conditions that are not stated are taken from the model: the side of approach and the mean temperature of its
identification.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.arm import Load
from calib.array import Array
from calib.compensate import model_sides, sides_that_move
from calib.data import ABSOLUTE_ACCURACY
from calib.errors import DataError
from calib.model import StatedConditions
from calib.saved import CalibratedModel
from calib.units import DEG

_OPTION = "--conditions"
_ACCURACY = "absolute-accuracy"
_KEYS = ("side", "approach", "temperature", "time", "mass", "cog", "series", _ACCURACY)
_SIDES = {"below": 1.0, "+1": 1.0, "1": 1.0, "+": 1.0, "above": -1.0, "-1": -1.0, "-": -1.0}
_IDENTIFIED = {"from below": 1.0, "from above": -1.0}


@dataclass(frozen=True)
class ProgramConditions:
    """Stated conditions as text and as numbers for programs, with notes on oddities."""

    stated: StatedConditions
    document: dict[str, Any]
    notes: tuple[str, ...]

    @property
    def in_words(self) -> str:
        """One line for people."""
        sides = self.document["side_of_model_joints"]
        words = ["from below" if side > 0 else "from above" for side in sides]
        side = words[0] if len(set(words)) == 1 else "joints " + ", ".join(words)
        air = self.document["temperature_c"]
        parts = [f"approach {side}", "temperature not stated" if air is None else f"{air:g} degC"]
        parts += [] if self.document["time_s"] is None else [f"{self.document['time_s']:g} s"]
        parts += (
            [] if self.document["mass_kg"] is None else [f"{self.document['mass_kg']:g} kg on the flange"]
        )
        parts += [] if self.document["series"] is None else [f"series {self.document['series']}"]
        return ", ".join(parts)


def stated_conditions(text: str | None, saved: CalibratedModel) -> ProgramConditions:
    """Parse conditions from the option's text.

    Raises
    ------
    DataError
        A condition is wrong; the message names its key.
    """
    given = _pairs(text or "")
    robot = saved.model.robot
    identified = saved.holds_for.get("approach") or ["both sides"] * robot.joints
    of_model = np.array([_IDENTIFIED.get(side, 1.0) for side in identified])
    notes = list(saved.notes)
    sides = of_model
    if "side" in given:
        sides = _sides(given["side"], saved)
        others = [
            k
            for k, side in enumerate(identified, start=1)
            if _IDENTIFIED.get(side, sides[k - 1]) != sides[k - 1]
        ]
        if others:
            notes.append(
                f"The model was identified with joints {', '.join(map(str, others))} arriving from the other side."
            )
    accuracy = given.get(_ACCURACY, "unknown")
    if accuracy not in ABSOLUTE_ACCURACY:
        raise DataError(
            f"'{accuracy}' is neither on nor off.", do="Write on or off.", key=f"{_OPTION} {_ACCURACY}"
        )
    if not saved.refuse_other_accuracy(accuracy, key=f"{_OPTION} {_ACCURACY}"):
        own = saved.holds_for.get("absolute_accuracy", "unknown")
        notes.append(
            "Where the controller's own absolute accuracy is on and was off when the model was identified, the robot "
            f"is corrected twice. Of the model it is {own}, of the controller {accuracy}: state it in [robot] of the "
            f"cell file and with --conditions {_ACCURACY}=on or off."
        )
    air = _number(given, "temperature") if "temperature" in given else saved.holds_for.get("temperature_c")
    time = _number(given, "time") if "time" in given else None
    loads, mass = saved.loads, None
    if "mass" in given or "cog" in given:
        mass = _number(given, "mass")
        loads = (*(load for load in loads if load.link != robot.joints), _load(given, mass, robot.joints))
    approach = _number(given, "approach") if "approach" in given else 5.0
    series = given.get("series")
    names = tuple(saved.model.targets)
    if series not in names and (series is not None or len(names) > 1):
        raise DataError(
            "is not a series of the model." if series else "must name a series: the model holds several.",
            do=f"Use {', '.join(names)}.",
            key=f"{_OPTION} series",
        )
    stated = StatedConditions(
        side=tuple(float(side) for side in sides),
        approach=approach * DEG,
        temperature_c=math.nan if air is None else float(air),
        time_s=math.nan if time is None else time,
        loads=loads,
        gravity=saved.gravity,
        series=series,
    )
    document = {
        "side_of_model_joints": [int(side) for side in sides],
        "approach_deg": approach,
        "temperature_c": air,
        "time_s": time,
        "mass_kg": mass,
        "series": series,
        "absolute_accuracy": accuracy,
    }
    return ProgramConditions(stated, document, tuple(notes))


def _pairs(text: str) -> dict[str, str]:
    out: dict[str, str] = {}
    for part in text.split(",") if text.strip() else ():
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or key not in _KEYS or key in out:
            raise DataError(
                f"'{part}' is not a condition, or given twice.",
                do=f"Write KEY=VALUE with {', '.join(_KEYS)}.",
                key=_OPTION,
            )
        out[key] = value
    return out


def _sides(text: str, saved: CalibratedModel) -> Array:
    """Return the sides (N,) of the model's joints from those of the controller's."""
    robot = saved.model.robot
    words = text.split(":")
    if len(words) not in (1, robot.joints) or not all(word in _SIDES for word in words):
        raise DataError(
            f"'{text}' is not a side.",
            do=f"Write below or above, once or {robot.joints} times with ':' between.",
            key=f"{_OPTION} side",
        )
    sides = np.array([_SIDES[word] for word in words])
    try:
        return model_sides(robot, np.broadcast_to(sides, (robot.joints,)), saved.coupling)
    except ValueError as error:
        moves = ":".join(f"{side:+d}" for side in sides_that_move(robot, saved.coupling))
        raise DataError(
            f"{error}.", do=f"State other sides, such as {moves}.", key=f"{_OPTION} side"
        ) from error


def _number(given: dict[str, str], key: str) -> float:
    try:
        value = float(given[key])
    except (KeyError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        raise DataError(
            f"'{given.get(key, '')}' is not a number.", do="Write a number.", key=f"{_OPTION} {key}"
        )
    return value


def _load(given: dict[str, str], mass: float, link: int) -> Load:
    try:
        x, y, z = (float(part) for part in given.get("cog", "").split(":"))
    except ValueError as error:
        raise DataError(
            "needs a mass and three coordinates.", do="Write mass=KG,cog=X:Y:Z.", key=f"{_OPTION} cog"
        ) from error
    if not (mass > 0.0 and all(math.isfinite(v) for v in (mass, x, y, z))):
        raise DataError("is not possible.", do="Give the mass in kg, above zero.", key=f"{_OPTION} mass")
    return Load(link, mass, (x, y, z))
