"""Models with two carried terms, made by hand: one follows a joint, one the time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib import Dataset, identify
from calib.fit import IdentificationFit
from calib.fit.identify import carry, fit_plain
from calib.model import BoundModel, Effect, EffectTerm, ModelStructure
from calib.model.carried_regressors import Held, OfTime
from calib.model.effect import Parameter
from calib.model.regressors import Regressor
from calib.units import to_internal


def carried(label: str, unit: str, regressor: Regressor, size: float = 0.1) -> Effect:
    slot = label.split(":")[1]
    parameter = Parameter(f"{label}.size", unit, size)
    meaning = f"{slot} follows something, for no known cause."
    return Effect(
        label, "carried", "robot", meaning, (parameter,), (EffectTerm(parameter.name, slot, 1.0, regressor),)
    )


def step(times: np.ndarray) -> OfTime:
    """Return a step: 0 in the first third of a campaign, then 1."""
    begin, end = float(times.min()), float(times.max())
    return OfTime(
        (begin, begin + (end - begin) / 3.0, begin + (end - begin) / 3.0 + 1.0, end), (0.0, 0.0, 1.0, 1.0)
    )


def fit_with(dataset: Dataset, fitted: IdentificationFit, model: ModelStructure) -> IdentificationFit:
    """The readings of a fit fitted with another model."""
    found = {
        p.name for p, v in zip(fitted.model.parameters, np.diag(fitted.covariance), strict=True) if v > 0.0
    }
    active = np.array([p.name in found or p.name.startswith("carried") for p in model.parameters])
    start = carry(fitted.model, fitted.estimate, model)
    return fit_plain(
        dataset,
        model,
        fitted.readings,
        start,
        active,
        fitted.dropped,
        fitted.faulty_rows,
        fitted.relabelled_rows,
    )


def carrying(data: Dataset) -> tuple[Dataset, IdentificationFit]:
    """Simulate readings with two carried terms, and the fit that carries both.

    theta4 follows joint 3, and d5 steps.
    """
    base, q = identify(data), data.conditions.joints[data.fit_rows, 2]
    inner = Held("angle", 3, "cubic", 1.0, 0.0, float(np.quantile(q, 0.1)), float(np.quantile(q, 0.9)))
    effects = (
        carried("carried:theta4:angle:1", "deg", inner),
        carried("carried:d5:time:2", "mm", step(data.conditions.time)),
    )
    model = base.model.append(*effects)
    truth = np.r_[base.estimate, to_internal(0.05, "deg"), 0.3]
    with_them, without = (
        BoundModel(model, data.conditions).predict(x) for x in (truth, np.r_[base.estimate, 0.0, 0.0])
    )
    dataset = replace(data, points=data.points + with_them - without)
    again = identify(dataset)
    return dataset, fit_with(dataset, again, again.model.append(*effects))
