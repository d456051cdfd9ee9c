"""Refinement of scanned values (orders, time constants, change points) between the places of the scan."""

from __future__ import annotations

from calib.effects import Survey, offers
from calib.model.effect import Effect
from calib.scan.harmonics import one_order
from calib.scan.space import Space


def refine(space: Space, chosen: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """The chosen effects at better orders, constants and change points; what was not scanned is unchanged."""
    if not any(effect.shape for effect in chosen):
        return chosen
    offered = offers(_survey(space))
    made_by = {i: family for i, effect in enumerate(chosen) for family in offered if family.made(effect)}
    refined = list(chosen)
    for kind in dict.fromkeys(type(family) for family in made_by.values()):
        own = {i: family for i, family in made_by.items() if type(family) is kind}
        better = kind.refine(space, [(family, chosen[i]) for i, family in own.items()])
        for i, effect in zip(own, better, strict=True):
            refined[i] = effect
    # Orders that met are one effect, or a pair of large amplitudes that cancel: the first, the stronger, keeps it.
    return tuple(
        effect
        for i, effect in enumerate(refined)
        if not any(one_order(space, effect, earlier) for earlier in refined[:i])
    )


def _survey(space: Space) -> Survey:
    model = space.fitted.model
    curves = frozenset(curve.joint for curve in model.curves)
    return Survey(model.robot, space.fitted.readings.conditions, curves=curves)
