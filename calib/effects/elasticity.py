"""Effects of elasticity: deflections under load, and undeclared loads.

Gears, links, bearings and the pedestal deflect. Links and bearings are designed for their load, so their usual size is
an angle under the largest moment.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calib.arm.robot import Load, Robot
from calib.effects.kind import OTHER_LOAD, EffectKind, EffectModule, Row
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import (
    GravityMoment,
    LoadTorque,
    MomentBehind,
    Overturning,
    Regressor,
    Torque,
    TorqueCubed,
)
from calib.scan.families import Candidate
from calib.units import to_display

_USUAL = 1e-3  # rad, under the largest torque or moment
_PER_MOMENT = "1e-6 rad/(N.m)"
_CUBED = "1e-15 rad/(N.mm)^3"


joint_compliance = Row(
    EffectKind(
        "joint_compliance",
        words="gear of joint {joint} yielding to gravity",
        check=(
            "Check the payload that the controller was told and, on joint {joint}, the bolts of gear and "
            "motor; hang a known mass on the flange and watch a dial gauge."
        ),
        apart=(OTHER_LOAD,),
    ),
    law="Joint compliance: the gear of a joint deflects with the gravity torque, c tau, with c >= 0.",
    means="The gear of joint {joint} yields to gravity.",
    parameter="c",
    unit="1e-6 rad/(N.mm)",
    size=1.0,
    slot="theta",
    regressor=Torque,
    where=lambda survey: [k for k in survey.moving if survey.loaded(k)],
    bounds=(0.0, None),
)


# Strain-wave gears are soft at small torques (wind-up curves of their makers); torques reach `largest` N.mm.
cubic_stiffness = Row(
    EffectKind(
        "cubic_stiffness",
        words="gear of joint {joint} yielding to large loads",
        check="Check the gear of joint {joint} for worn teeth, and that the load is within what it is rated for.",
        apart=(OTHER_LOAD,),
    ),
    law="Cubic stiffness: a gear is softer or stiffer under large loads, c tau^3 beside its compliance c tau.",
    means="The gear of joint {joint} yields out of proportion to a large load.",
    parameter="c",
    unit=_CUBED,
    size=lambda largest: to_display(_USUAL / largest**3, _CUBED),
    slot="theta",
    regressor=TorqueCubed,
    where=lambda survey: [k for k in survey.moving if survey.loaded(k)],
    measure=lambda survey, joint: survey.largest(survey.conditions.torque[:, joint - 1]),
)


def _about_alpha(robot: Robot, link: int) -> Regressor:
    """Return the gravity moment about axis x of alpha.

    It acts in frame K-1 in modified DH, and in frame K behind joint K in standard DH.
    """
    return GravityMoment(link, 0) if robot.convention == "mdh" else MomentBehind(link, robot.theta[link - 1])


def link_torsion(robot: Robot, link: int, largest: float) -> Effect:
    """Build the torsional compliance of a link; parameter c, 1e-6 rad/(N.m).

    The moments reach `largest` N.mm.
    """
    size = to_display(_USUAL / largest, _PER_MOMENT)
    return effect(
        f"link_torsion:j{link}",
        "structure",
        "robot",
        f"Link {link} twists about its length under the weight it carries.",
        {"c": (_PER_MOMENT, size, [(f"alpha{link}", _about_alpha(robot, link))], (0.0, None))},
    )


def _offer_link_torsion(survey: Survey) -> list[Candidate]:
    candidates = []
    for link in survey.moving:
        moment = np.asarray(_about_alpha(survey.robot, link).evaluate(survey.conditions))
        if survey.strains(moment):
            candidates.append(Candidate(link_torsion(survey.robot, link, survey.largest(moment))))
    return candidates


def bearing_tilt(joint: int, largest: float) -> Effect:
    """Build the tilt of the bearing of a joint by c M_x about x and c M_y about y.

    The moments reach `largest` N.mm. Both directions have one compliance, since a bearing is round; parameter c,
    1e-6 rad/(N.m).
    """
    size = to_display(_USUAL / largest, _PER_MOMENT)
    places = [
        (f"bearing{joint}.rx", GravityMoment(joint, 0)),
        (f"bearing{joint}.ry", GravityMoment(joint, 1)),
    ]
    return effect(
        f"bearing_tilt:j{joint}",
        "structure",
        "robot",
        f"The bearing of joint {joint} tilts under the weight it carries.",
        {"c": (_PER_MOMENT, size, places, (0.0, None))},
    )


def _offer_bearing_tilt(survey: Survey) -> list[Candidate]:
    moment = survey.conditions.moment
    return [
        Candidate(bearing_tilt(k, survey.largest(moment[:, k - 1, :2])))
        for k in (*survey.moving, *survey.sliding)
        if survey.strains(moment[:, k - 1, 0]) or survey.strains(moment[:, k - 1, 1])
    ]


def pedestal(robot: Robot) -> Effect:
    """Build the compliance of the pedestal about axes x and y of the base.

    The parameters are x and y, 1e-6 rad/(N.m). A table, a rail or a frame is seldom equally stiff about both axes. It
    leans about the origin of the base. In Nubiola's robots d_1 comes before the turns of the base, which turn about a
    point d_1 above it. The shift that this leaves out is added.
    """
    about_x, about_y = Overturning(0), Overturning(1)
    height = robot.d[0] if robot.base == "thesis" else 0.0
    places_x = [("base.rx", about_x, 1.0), ("base.y", about_x, -height)]
    places_y = [("base.ry", about_y, 1.0), ("base.x", about_y, height)]
    return effect(
        "pedestal",
        "structure",
        "mounting",
        "The pedestal leans to where the arm reaches out.",
        {
            "x": ("1e-6 rad/(N.m)", 5.0, [place for place in places_x if place[2] != 0.0], (0.0, None)),
            "y": ("1e-6 rad/(N.m)", 5.0, [place for place in places_y if place[2] != 0.0], (0.0, None)),
        },
    )


def _offer_pedestal(survey: Survey) -> list[Candidate]:
    overturning = survey.conditions.overturning
    if not (survey.strains(overturning[:, 0]) and survey.strains(overturning[:, 1])):
        return []
    return [Candidate(pedestal(survey.robot))]


Compliance = Mapping[int, float]
"""Joint -> rad/(N.mm)."""


def payload_mass(
    centre: tuple[float, float, float], compliance: Compliance, declared_kg: float = 0.0
) -> Effect:
    """Build the effect of additional mass on the last link; parameter mass, kg.

    The `centre` is in mm in that link's frame. The mass turns every joint by its compliance, a constant of the effect
    as estimated, times the missing torque. Together with the declared mass it is never negative. The compliances absorb
    most of a wrong mass (0.95). Source: Nubiola, thesis 2.5 (10 % errors of mass and centre).
    """
    joints = [(f"theta{k}", LoadTorque(k, 1.0, *centre), c) for k, c in compliance.items()]
    return effect(
        "payload_mass",
        "frames and tool",
        "mounting",
        "The load on the last link is heavier or lighter than declared.",
        {"mass": ("kg", 0.5, joints, (-declared_kg, None))},
    )


def payload_cog(load: Load, compliance: Compliance) -> Effect:
    """Build the effect of another centre of `load`; parameters x, y, z, mm.

    They are in the frame of the last link.
    """
    kg = load.mass_kg
    along = {"x": (kg, 0.0, 0.0), "y": (0.0, kg, 0.0), "z": (0.0, 0.0, kg)}
    return effect(
        "payload_cog",
        "frames and tool",
        "mounting",
        "The centre of the load on the last link lies elsewhere than declared.",
        {
            axis: (
                "mm",
                30.0,
                [(f"theta{k}", LoadTorque(k, 0.0, *kg_mm), c) for k, c in compliance.items()],
                (-500.0, 500.0),
            )
            for axis, kg_mm in along.items()
        },
    )


def _offer_payload(survey: Survey) -> list[Candidate]:
    """Offer mass and centre of the payload if the model has compliances.

    The centre is offered only for a declared load.
    """
    compliance = {k: c for k, c in survey.compliance.items() if c != 0.0 and survey.loaded(k)}
    if not compliance:
        return []
    load = survey.payload
    if load is None:
        return [Candidate(payload_mass((0.0, 0.0, 0.0), compliance))]
    mass = payload_mass(load.cog_mm, compliance, load.mass_kg)
    return [Candidate(mass), Candidate(payload_cog(load, compliance))]


LINK_TORSION = EffectModule(
    (
        "Link torsion: a link twists under gravity, alpha_K grows by c M_x, M_x the moment at joint K about "
        "alpha's axis x."
    ),
    (
        EffectKind(
            "link_torsion",
            words="twisting of link {joint}",
            check="Check the bolts at both ends of link {joint}, and the link for a crack if the value has grown.",
            apart=(OTHER_LOAD,),
        ),
    ),
    _offer_link_torsion,
)
BEARING_TILT = EffectModule(
    "Bearing tilt: the bearing of a joint tilts under the moment across its axis, c M_x about x and c M_y about y.",
    (
        EffectKind(
            "bearing_tilt",
            words="tilting bearing of joint {joint}",
            check=(
                "Check the main bearing of joint {joint} for play across its axis with a dial gauge and a "
                "lever, and its bolts."
            ),
            apart=(OTHER_LOAD,),
        ),
    ),
    _offer_bearing_tilt,
)
PEDESTAL = EffectModule(
    "Pedestal: the support of the robot leans by its compliance times the overturning moment of the arm.",
    (
        EffectKind(
            "pedestal",
            words="leaning pedestal",
            check=(
                "Check the anchor bolts and the grout of the pedestal; put a dial gauge beside the foot and "
                "reach out the arm to each side."
            ),
            apart=(OTHER_LOAD,),
        ),
    ),
    _offer_pedestal,
)
PAYLOAD = EffectModule(
    "Payload: a load that differs from the declared one turns every joint by its compliance times the missing torque.",
    (
        EffectKind(
            "payload_mass",
            words="mass of the load",
            check="Weigh the tool with everything that hangs on it, and correct the load data in the controller.",
            apart=(OTHER_LOAD,),
            changed="The load on the flange is heavier than declared by {size}.",
            remedy="Weigh the tool with all that hangs on it, and correct the load data.",
        ),
        EffectKind(
            "payload_cog",
            words="centre of mass of the load",
            check=(
                "Work out the centre of mass of tool, hoses and cables anew, and correct the load data in the "
                "controller."
            ),
            apart=(OTHER_LOAD,),
            changed="The centre of the load on the flange lies elsewhere by {size}.",
            remedy="Look for what was moved, added or taken off at the tool, and correct the load data.",
        ),
    ),
    _offer_payload,
    lambda survey: [candidate.effect for candidate in _offer_payload(survey)],
)
