"""Columns that look like misspelt missing ones: with a misspelt `status` rejected rows would be used."""

from __future__ import annotations

import re
from difflib import get_close_matches
from itertools import chain

from calib.arm.robot import Robot
from calib.errors import DataError
from calib.text.columns import Columns

_NEAR = 0.88  # likeness, of 1: one letter too many, too few or swapped in a name of eight
_ONCE = (
    *(
        "reading_id",
        "series",
        "set",
        "t_s",
        "tool_target",
        "base_target",
        "other_target",
        "x_mm",
        "y_mm",
        "z_mm",
    ),
    *(
        "rot_w",
        "rot_x",
        "rot_y",
        "rot_z",
        "length_mm",
        "u_x_mm",
        "u_y_mm",
        "u_z_mm",
        "u_length_mm",
        "u_rot_mrad",
    ),
    *("t_air_c", "waypoint", "visit", "status"),
)
_FOR_PEOPLE = re.compile(r"[je]\d+_read_(deg|mm)|t_.+_c")
_DIGITS = re.compile(r"\d+")


def refuse_misspelt(table: Columns, robot: Robot) -> None:
    """Raise DataError for an unknown column that must be a misspelt known one.

    A name that differs only in its number is accepted as it is: a seventh axis.
    """
    of_joint = zip(robot.joint_columns, robot.approach_columns, robot.previous_columns, strict=True)
    read_back = [re.sub("_", "_read_", name, count=1) for name in robot.joint_columns]
    known = [*_ONCE, *chain.from_iterable(zip(*of_joint, strict=True)), *read_back]
    absent = [name for name in known if name not in table]
    for name in table.names:
        if name in known or _FOR_PEOPLE.fullmatch(name):
            continue
        near = get_close_matches(name.strip().lower(), absent, n=1, cutoff=_NEAR)
        if near and _typed_for(name, near[0]):
            raise DataError(
                f"column '{name}' is not known.",
                do=f"Did you mean '{near[0]}'? Correct it, or give it a name less like it.",
                file=table.path,
                line=1,
            )


def _typed_for(name: str, known: str) -> bool:
    """Whether a name may be a known one with a slip: not where a number differs, a word was put to it, or another
    letter stands alone (`d_length_mm` beside `u_length_mm`)."""
    if _DIGITS.sub("", known) == _DIGITS.sub("", name):
        return False
    words, others = (text.strip().lower().split("_") for text in (name, known))
    if len(words) != len(others):
        return "".join(words) == "".join(others)
    return all(len(a) > 1 or len(b) > 1 for a, b in zip(words, others, strict=True) if a != b)
