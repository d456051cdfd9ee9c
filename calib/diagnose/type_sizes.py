"""Effects that were found in a robot, held to the sizes that they have in robots of its type.

The search knows nothing of these sizes: an effect is claimed by the readings, or not at all. Once it is in the model,
its parameters have the type's mean and spread for a prior, as those of the base model have, and lose it again where
this robot lies outside (`calib.fit.of_type`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.data.dataset import Dataset
from calib.diagnose.named import Found
from calib.fit.identification import Identification
from calib.fit.identify import fit_plain
from calib.fit.of_type import Beside, centred, loosened, stranger, together
from calib.model.model import RobotModel


def in_type(
    dataset: Dataset, fitted: Identification, beside: Beside, found: list[Found], *, refit: bool
) -> tuple[Identification, list[Found]]:
    """The fit with what was found held to its type, and the findings with their new values.

    beside: the base model's; refit: False where curves of gears are in the model, whose sizes the readings say: then
    the effects keep their usual sizes.
    """
    names = frozenset(p.name for f in found for p in f.effect.parameters) & frozenset(beside.prior.shares)
    if refit and names:
        fitted, beside = _held(dataset, fitted, beside, names)
    square, freedom = together(fitted.model, fitted.estimate, fitted.covariance, 1.0 / fitted.held_std)
    beside = replace(beside, chi_square=square, freedom=freedom) if beside.widened == 1.0 else beside
    fitted = replace(fitted, beside=beside, warnings=(*beside.warnings(), *fitted.warnings))
    return fitted, [_again(f, fitted) for f in found]


def _held(
    dataset: Dataset, plain: Identification, beside: Beside, names: frozenset[str]
) -> tuple[Identification, Beside]:
    def fitted(model: RobotModel) -> Identification:
        return fit_plain(
            dataset,
            model,
            plain.readings,
            plain.estimate,
            np.diag(plain.covariance) > 0.0,
            plain.dropped,
            plain.faulty_rows,
            plain.relabelled_rows,
        )

    model = centred(plain.model, beside.prior, names)
    found = fitted(model)
    while stray := stranger(tuple(w for w in found.weighed if w.name in names)):
        beside = replace(beside, outside=(*beside.outside, stray))
        model = loosened(model, plain.model, frozenset({stray.name}))
        found = fitted(model)
    return found, beside


def _again(found: Found, fitted: Identification) -> Found:
    effect = next((e for e in fitted.model.effects if e.label == found.effect.label), found.effect)
    positions = fitted.model.positions(effect)
    return replace(
        found,
        effect=effect,
        values=fitted.estimate[positions],
        covariance=fitted.covariance[np.ix_(positions, positions)],
    )
