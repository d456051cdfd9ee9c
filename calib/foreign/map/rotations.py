"""Conventions by which three numbers are an orientation, by the names that people know them by.

`intrinsic-XYZ` turns about the axes as they have turned, `fixed-XYZ` about those that stay; the three columns are in
the order in which the convention is written. Sources: KUKA (A, B, C about Z, Y', X''), Fanuc (W, P, R about fixed X,
Y, Z), Staubli (Rx, Ry, Rz about X, Y', Z''), UR (a rotation vector, about its direction by its length).
"""

from __future__ import annotations

import re

import numpy as np
from scipy.spatial.transform import Rotation

from calib.array import Array

NAMED = {
    "kuka-abc": "ZYX",
    "fanuc-wpr": "xyz",
    "staubli": "XYZ",
    "roll-pitch-yaw": "xyz",
}
VECTOR = "rotation-vector"
USUAL = ("kuka-abc", "fanuc-wpr", "staubli", VECTOR)
"""Conventions that are asked about, each rotation once: `roll-pitch-yaw` is `fanuc-wpr` by another name."""
_SEQUENCE = re.compile(r"(intrinsic|fixed)-([XYZ])([XYZ])([XYZ])")
ANGLES_OF = {
    "abc": ("kuka-abc", "the names A, B, C are KUKA's"),
    "wpr": ("fanuc-wpr", "the names W, P, R are Fanuc's"),
}
NAME_OF = {("rpy", "fanuc-wpr"): "roll-pitch-yaw"}
"""Family of angles and convention -> its name for these."""
FOR_PEOPLE = (*USUAL, "roll-pitch-yaw", "intrinsic-ZYX (any three axes)", "fixed-XYZ (any three axes)")


def sequence_of(convention: str) -> str | None:
    """The sequence as scipy has it, `VECTOR` for a rotation vector; None for what is no convention."""
    if convention == VECTOR:
        return VECTOR
    if convention in NAMED:
        return NAMED[convention]
    match = _SEQUENCE.fullmatch(convention)
    if match is None or match[2] == match[3] or match[3] == match[4]:
        return None
    axes = match[2] + match[3] + match[4]
    return axes if match[1] == "intrinsic" else axes.lower()


def quaternions(numbers: Array, convention: str) -> Array:
    """(n, 4) scalar first, of numbers (n, 3), rad, by a convention; NaN where one is. Raises KeyError for no
    convention."""
    sequence = sequence_of(convention)
    if sequence is None:
        raise KeyError(convention)
    out = np.full((len(numbers), 4), np.nan)
    given = np.isfinite(numbers).all(axis=1)
    if given.any():
        of = numbers[given]
        turn = Rotation.from_rotvec(of) if sequence == VECTOR else Rotation.from_euler(sequence, of)
        out[given] = turn.as_quat(scalar_first=True)
    return out
