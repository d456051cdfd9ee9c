"""Effects of slides: linear axes that carry the arm or its tool."""

from __future__ import annotations

from calib.effects.kind import OTHER_LOAD, OTHER_SIDE, OTHER_WARMTH, EffectKind, EffectModule, Row
from calib.effects.survey import Survey
from calib.model.effect import Effect, Written, effect
from calib.model.regressors import ApproachSide, HalfCosines, HalfSines, JointAngle, Torque, WarmTravel
from calib.scan.families import Candidate

_LEAST_FORCE = 1.0  # N
_HALF_WAVES = 4
_LEAST_TRAVEL = 0.3  # share of the travel that readings must span to show a curve


slide_scale = Row(
    EffectKind(
        "slide_scale",
        words="scale of slide {joint}",
        check=(
            "Compare the pitch of rack, screw or belt of axis {joint} in the controller with its drawing, and drive "
            "the whole travel beside a laser or a tape."
        ),
        apart=(),
    ),
    law=(
        "Scale of a slide: the carriage moves (1 + k) times the counted travel, k q, by the pitch of rack, screw "
        "or belt."
    ),
    means="Joint {joint} slides by more or less than it counts, in proportion to its travel.",
    parameter="scale",
    unit="ppm",
    size=200.0,
    slot="d",
    regressor=JointAngle,
    where=lambda survey: survey.sliding,
    bounds=(-20000.0, 20000.0),
)

slide_backlash = Row(
    EffectKind(
        "slide_backlash",
        words="play of slide {joint}",
        check=(
            "Check the play between pinion and rack, or the preload of nut or belt, of axis {joint}: push the carriage "
            "both ways with the brakes on and read a dial gauge."
        ),
        apart=(OTHER_SIDE,),
        changed="Axis {joint} has another play than at the calibration: {size}.",
        remedy="Have the drive of axis {joint} checked; until then correct targets with the updated model.",
    ),
    law=(
        "Backlash of a slide: the carriage stops half a gap short on the side from which it came, gap/2 x side of "
        "approach."
    ),
    means="Joint {joint} has play: it stops short on the side from which it arrives.",
    parameter="gap",
    unit="mm",
    size=0.2,
    slot="d",
    regressor=ApproachSide,
    where=lambda survey: [k for k in survey.sliding if survey.varies(survey.conditions.side[:, k - 1])],
    weight=0.5,
    bounds=(0.0, 5.0),
)

# If the axis keeps its direction, the force is
# constant and part of the zero: then nothing is offered.
slide_compliance = Row(
    EffectKind(
        "slide_compliance",
        words="yielding drive of slide {joint}",
        check="Check belt tension, or nut and bearings of the screw, of axis {joint} under its load.",
        apart=(OTHER_LOAD,),
    ),
    law="Compliance of a slide: the carriage deflects along its axis under the weight that it carries, c F.",
    means="The drive of joint {joint} yields to the weight along its axis.",
    parameter="c",
    unit="um/N",
    size=0.1,
    slot="d",
    regressor=Torque,
    where=lambda survey: [
        k
        for k in survey.sliding
        if survey.varies(survey.conditions.torque[:, k - 1])
        and survey.largest(survey.conditions.torque[:, k - 1]) > _LEAST_FORCE
    ],
    bounds=(0.0, None),
    group="structure",
)


# Steel: 11 to 12.
slide_growth = Row(
    EffectKind(
        "slide_growth",
        words="growth of axis {joint} with the air temperature",
        check="Look what warms rack or screw of axis {joint} (sun, drive, hall), and measure at a steady temperature.",
        apart=(OTHER_WARMTH,),
    ),
    law="Thermal growth of a slide: rack, screw or scale lengthens with the air, k q (T - T-).",
    means="The travel of joint {joint} grows with the air temperature.",
    parameter="k",
    unit="1e-6/K",
    size=12.0,
    slot="d",
    regressor=WarmTravel,
    where=lambda survey: [] if survey.air_c is None else survey.sliding,
    bounds=(-50.0, 100.0),
    group="thermal",
    measure=lambda survey, joint: survey.air_c or 0.0,
    shape="reference_c",
)


def _waves(
    slots: dict[str, str], joint: int, low: float, high: float, unit: str, size: float
) -> dict[str, Written]:
    wave = HalfSines if unit == "mm" else HalfCosines
    return {
        f"{name}{count}": (unit, size, [(slot, wave(joint, count, low, high))])
        for name, slot in slots.items()
        for count in range(1, _HALF_WAVES + 1)
    }


def slide_straightness(joint: int, low: float, high: float) -> Effect:
    """Build the straightness error of a sliding joint's rail; parameters x1 .. and y1 .., mm.

    The joint slides from `low` to `high`, mm.
    """
    return effect(
        f"slide_straightness:j{joint}",
        "structure",
        "robot",
        f"The rail of joint {joint} is not straight: its carriage goes aside.",
        _waves({"x": f"bearing{joint}.x", "y": f"bearing{joint}.y"}, joint, low, high, "mm", 0.2),
    )


def slide_angles(joint: int, low: float, high: float) -> Effect:
    """Build pitch, yaw and roll of a carriage; parameters rx1, ry1, rz1 .., mrad.

    The joint slides from `low` to `high`, mm.
    """
    slots = {"rx": f"bearing{joint}.rx", "ry": f"bearing{joint}.ry", "rz": f"theta{joint}"}
    return effect(
        f"slide_angles:j{joint}",
        "structure",
        "robot",
        f"The carriage of joint {joint} pitches, yaws and rolls along its rail.",
        _waves(slots, joint, low, high, "mrad", 0.3),
    )


def slide_pitch(joint: int, low: float, high: float) -> Effect:
    """Build the error of an uneven rack or screw; parameters z1 .., mm.

    The joint slides from `low` to `high`, mm.
    """
    return effect(
        f"slide_pitch:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint} runs ahead and behind along its travel.",
        _waves({"z": f"d{joint}"}, joint, low, high, "mm", 0.1),
    )


def _offer_slide_guide(survey: Survey) -> list[Candidate]:
    """Offer three smooth curves for each joint that slid over a good part of its travel.

    straightness  the carriage moves sideways, x and y: sines of 1 to 4 half waves over the travel, zero at both ends,
                  since a shift and a tilt are the position and the direction of the axis
    angles        it pitches, yaws and rolls, rx, ry and rz: cosines of 1 to 4 half waves, since a constant is a turn of
                  the parts that it carries
    position      it runs ahead and behind along the axis: sines; a proportional error is `slide_scale`

    Source: ISO 230-1 (straightness, angular and positioning deviations of a linear axis).
    """
    candidates = []
    for k in survey.sliding:
        low, high = survey.robot.lower[k - 1], survey.robot.upper[k - 1]
        joints = survey.conditions.joints[:, k - 1]
        if float(joints.max() - joints.min()) > _LEAST_TRAVEL * (high - low):
            curves = (slide_straightness, slide_angles, slide_pitch)
            candidates += [Candidate(curve(k, low, high)) for curve in curves]
    return candidates


SLIDE_GUIDE = EffectModule(
    "Guide of a slide: its rail is not straight and its screw not even, smooth curves over the travel.",
    (
        EffectKind(
            "slide_straightness",
            words="crooked rail of axis {joint}",
            check=(
                "Measure the rail of axis {joint} with a straight edge, a taut wire or the tracker on the carriage, "
                "and shim its supports; look for a loose anchor."
            ),
            apart=(),
        ),
        EffectKind(
            "slide_angles",
            words="rocking carriage of axis {joint}",
            check=(
                "Set a level on the carriage of axis {joint} and drive the travel; check anchors and supports of the "
                "rail where it tips, and the preload of the carriage."
            ),
            apart=(),
        ),
        EffectKind(
            "slide_pitch",
            words="uneven rack or screw of axis {joint}",
            check="Check the joints between pieces of the rack of axis {joint}, or the screw, for gaps and wear.",
            apart=(),
        ),
    ),
    _offer_slide_guide,
)
