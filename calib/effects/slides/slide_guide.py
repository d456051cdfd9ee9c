"""Guide of a slide: its rail is not straight and its screw not even, smooth curves over the travel.

    straightness  the carriage moves sideways, x and y: sines of 1 to 4 half waves over the travel, zero at both ends,
                  since a shift and a lean are the place and the direction of the axis
    angles        it pitches, yaws and rolls, rx, ry and rz: cosines of 1 to 4 half waves, since a constant is a turn of
                  what it carries
    position      it runs ahead and behind along the axis: sines; what is in proportion is `slide_scale`

Source: ISO 230-1 (straightness, angular and positioning deviations of a linear axis).
"""

from __future__ import annotations

from calib.effects.kind import Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, Written, effect
from calib.model.slide_regressors import HalfCosines, HalfSines
from calib.scan.fixed import Candidate

HALF_WAVES = 4
_LEAST_TRAVEL = 0.3  # share of the travel that readings must span to show a curve

KINDS = (
    Kind(
        "slide_straightness",
        words="crooked rail of axis {joint}",
        check=(
            "Measure the rail of axis {joint} with a straight edge, a taut wire or the tracker on the carriage, and "
            "shim its supports; look for a loose anchor."
        ),
        apart=(),
    ),
    Kind(
        "slide_angles",
        words="rocking carriage of axis {joint}",
        check=(
            "Set a level on the carriage of axis {joint} and drive the travel; check anchors and supports of the rail "
            "where it tips, and the preload of the carriage."
        ),
        apart=(),
    ),
    Kind(
        "slide_pitch",
        words="uneven rack or screw of axis {joint}",
        check="Check the joints between pieces of the rack of axis {joint}, or the screw, for gaps and wear.",
        apart=(),
    ),
)


def _waves(
    slots: dict[str, str], joint: int, low: float, high: float, unit: str, size: float
) -> dict[str, Written]:
    wave = HalfSines if unit == "mm" else HalfCosines
    return {
        f"{name}{count}": (unit, size, [(slot, wave(joint, count, low, high))])
        for name, slot in slots.items()
        for count in range(1, HALF_WAVES + 1)
    }


def slide_straightness(joint: int, low: float, high: float) -> Effect:
    """Rail of the slide `joint`, which goes from low to high, mm; parameters x1 .. and y1 .., mm."""
    return effect(
        f"slide_straightness:j{joint}",
        "structure",
        "robot",
        f"The rail of joint {joint} is not straight: its carriage goes aside.",
        _waves({"x": f"bearing{joint}.x", "y": f"bearing{joint}.y"}, joint, low, high, "mm", 0.2),
    )


def slide_angles(joint: int, low: float, high: float) -> Effect:
    """Pitch, yaw and roll of the carriage of the slide `joint`, low to high, mm; parameters rx1, ry1, rz1 .., mrad."""
    slots = {"rx": f"bearing{joint}.rx", "ry": f"bearing{joint}.ry", "rz": f"theta{joint}"}
    return effect(
        f"slide_angles:j{joint}",
        "structure",
        "robot",
        f"The carriage of joint {joint} pitches, yaws and rolls along its rail.",
        _waves(slots, joint, low, high, "mrad", 0.3),
    )


def slide_pitch(joint: int, low: float, high: float) -> Effect:
    """Uneven rack or screw of the slide `joint`, low to high, mm; parameters z1 .., mm."""
    return effect(
        f"slide_pitch:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint} runs ahead and behind along its travel.",
        _waves({"z": f"d{joint}"}, joint, low, high, "mm", 0.1),
    )


def offer(survey: Survey) -> list[Candidate]:
    """The three curves of each joint that slid over a good part of its travel."""
    candidates = []
    for k in survey.sliding:
        low, high = survey.robot.lower[k - 1], survey.robot.upper[k - 1]
        joints = survey.conditions.joints[:, k - 1]
        if float(joints.max() - joints.min()) > _LEAST_TRAVEL * (high - low):
            curves = (slide_straightness, slide_angles, slide_pitch)
            candidates += [Candidate(curve(k, low, high)) for curve in curves]
    return candidates
