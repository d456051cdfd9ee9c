"""The completed model with the prior of the robot's type, all of whose rows are tried again.

The search knows nothing of the sizes that effects have in the type: an effect is claimed by the readings, or not at
all. Once it is in the model its parameters have the type's mean and spread for a prior, as those of the base model do.
What lay outside the type while the model lacked an effect may lie within it now (a wave of a gear looks like
compliance), so every prior row is there again, and is taken out where this robot lies outside (`calib.fit.of_type`).
"""

from __future__ import annotations

from dataclasses import replace

from calib.data.dataset import Dataset
from calib.diagnose.named import Found, resized
from calib.fit.again import fit_again
from calib.fit.identification import Identification
from calib.fit.identify import within_type
from calib.fit.of_type import Beside, centred
from calib.fit.placing import base_model_of
from calib.model.base_model import named_in
from calib.model.model import RobotModel


def in_type(
    dataset: Dataset, fitted: Identification, beside: Beside, found: list[Found], *, refit: bool
) -> tuple[Identification, list[Found]]:
    """The fit held to its type with what was found, and the findings with their new values.

    beside: the base model's; refit: False where curves of gears are in the model, whose sizes the readings say: then
    all stays as the base model had it.
    """
    if not refit:
        return replace(fitted, beside=beside, warnings=(*beside.warnings(), *fitted.warnings)), found
    base = base_model_of(dataset)
    usual = {p.name: p for e in (*base.effects, *(f.effect for f in found)) for p in e.parameters}

    def again(model: RobotModel) -> Identification:
        return fit_again(dataset, fitted, model)

    spoken_for = named_in(base.effects, dataset.header.priors)
    wanted = frozenset(beside.prior.shares) - frozenset(beside.open) - spoken_for
    model = centred(fitted.model, beside.prior, wanted)
    final = within_type(again(model), Beside(beside.prior, open=beside.open), usual, again)
    return final, [resized(f, final) for f in found]
