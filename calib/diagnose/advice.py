"""What to measure next when the cause of an error is unknown, from the places where it was seen.

A place is a pair of strings: the quantity that drives an error, and that on which it acts, as `Structure` has them.
The advice varies that quantity alone, so that the next diagnosis can tell it from what was varied together with it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from calib.diagnose.outlying import ACTS_ON
from calib.diagnose.places import DISTANCE, OVERTURNING, QUICK, SIGHT, TIME, TOGETHER
from calib.diagnose.repeats import EACH_POSE

_MOST = 5  # sentences
_AXIS = r"([^\s]+)"

_SWEEP = (
    "Move joint {} alone through its range in small steps, up and back down, with all other joints at rest; "
    "read at every step."
)
_PAIR = (
    "Move joint {0} alone through its range at three positions of joint {1}; then exchange the two joints."
)
_SIDES = (
    "Visit the first ten poses again, once with joint {} arriving from below and once from above, "
    "with the same last move otherwise."
)
_MOVES = "Visit the same poses after last moves of joint {} of several lengths, such as 2, 10 and 40 degrees."
_LOAD = "Measure some of the same poses with another payload, declared in the header."
_REPEAT = (
    "Repeat the first ten poses now, in the middle and at the end of the next campaign: what depends on time "
    "differs, what depends on the pose does not."
)
_STILL = "Read one pose thirty times without moving the robot: this shows the noise of the instrument alone."
_PAUSE = "Read the same pose at once, after 10 s and after 60 s at rest, at several poses."
_WARMTH = (
    "Measure the same poses at another air temperature, and record it for each reading (t_air_c); "
    "let it rise and fall, so that it does not follow the clock."
)
_STATION = "Measure some of the same poses again with the instrument at another place."
_TURN = "Measure the same places with the tool turned by 90 and by 180 degrees, and all tool targets at each pose."
_SINGLE = "Move each joint alone through its range, all others at rest: this shows which joint it belongs to."
_NEAR = "Measure more poses near those where the error is largest."
_AGAIN = "Measure the poses of the readings that were left out again: faulty readings do not repeat, an effect does."

_OF_JOINT = (
    (re.compile(rf"joint {_AXIS} and joint {_AXIS} angles"), _PAIR),
    (re.compile(rf"joint {_AXIS} angle"), _SWEEP),
    (re.compile(rf"side of approach of joint {_AXIS}.*"), _SIDES),
    (re.compile(rf"last move (?:but one )?of joint {_AXIS}"), _MOVES),
)
_OF_PLACE = (
    (("torque", "moment across", "last change of torque", OVERTURNING, "payload"), _LOAD),
    ((QUICK,), _STILL),
    (("time since the last move",), _PAUSE),
    ((TIME,), _REPEAT),
    (("temperature",), _WARMTH),
    (("tool target", "direction of the tool", "side of the tool"), _TURN),
    (("region of the workspace", "direction of view", DISTANCE, SIGHT), _STATION),
    ((EACH_POSE,), _NEAR),
    ((TOGETHER,), _SINGLE),
)


def next_measurements(places: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Sentences on what to measure next, the most telling place first; for no place, what separates noise from a law.

    places: (what drives the error, what it acts on), as `Structure.where` and `Structure.acts_on`.
    """
    advice: list[str] = []
    for where, acts_on in places:
        if acts_on == ACTS_ON:
            advice.append(_AGAIN)
        advice.append(_of(where))
        # a joint that errs with the load or the time is examined by itself as well
        if own := re.fullmatch(rf"joint {_AXIS}", acts_on):
            advice.append(_SWEEP.format(own[1]))
        if acts_on == SIGHT:
            advice.append(_STATION)
    told = list(dict.fromkeys(advice))[:_MOST]
    return tuple(told or (_REPEAT, _STILL))


def _of(where: str) -> str:
    for pattern, sentence in _OF_JOINT:
        if found := pattern.fullmatch(where):
            return sentence.format(*found.groups())
    return next(
        (sentence for begins, sentence in _OF_PLACE if where.startswith(begins)),
        _REPEAT,
    )
