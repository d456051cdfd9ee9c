"""Payload: a load that differs from the declared one turns every joint by its compliance times the missing torque.

The torque is linear in mass and in mass x centre of the load on the last link. The compliances are those of the
model as estimated, constants of the effect. They absorb most of a wrong mass (0.95). Source:
Nubiola, thesis 2.5 (10 % errors of mass and centre).
"""

from __future__ import annotations

from collections.abc import Mapping

from calib.arm.robot import Load
from calib.effects.kind import OTHER_LOAD, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.gravity_regressors import LoadTorque
from calib.scan.fixed import Candidate

Compliance = Mapping[int, float]
"""Joint -> rad/(N.mm)."""


KINDS = (
    Kind(
        "payload_mass",
        words="mass of the load",
        check="Weigh the tool with everything that hangs on it, and correct the load data in the controller.",
        apart=(OTHER_LOAD,),
        changed="The load on the flange is heavier than declared by {size}.",
        remedy="Weigh the tool with all that hangs on it, and correct the load data.",
    ),
    Kind(
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
)


def payload_mass(
    centre: tuple[float, float, float], compliance: Compliance, declared_kg: float = 0.0
) -> Effect:
    """More mass on the last link, with its `centre` (mm, that link's frame); parameter mass, kg.

    Together with the declared mass it is never negative.
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
    """Another centre of `load`; parameters x, y, z, mm, in the last link's frame."""
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


def changes(survey: Survey) -> list[Effect]:
    """The effects of a load that has changed since a calibration."""
    return [candidate.effect for candidate in offer(survey)]


def offer(survey: Survey) -> list[Candidate]:
    """Mass and centre, where the model has compliances; the centre only of a declared load."""
    compliance = {k: c for k, c in survey.compliance.items() if c != 0.0 and survey.loaded(k)}
    if not compliance:
        return []
    load = survey.payload
    if load is None:
        return [Candidate(payload_mass((0.0, 0.0, 0.0), compliance))]
    mass = payload_mass(load.cog_mm, compliance, load.mass_kg)
    return [Candidate(mass), Candidate(payload_cog(load, compliance))]
