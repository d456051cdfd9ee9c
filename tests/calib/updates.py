"""Updated models: in memory as `truepose watch --update` writes them, and as a start."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.effects.thermal import warm_up
from calib.fit.identification import IdentificationFit
from calib.saved import CalibratedModel, save_model, save_update
from calib.watch import WhitenedReadings, updated
from calib.watch.cause import Cause


def as_updated(saved: CalibratedModel, seen: WhitenedReadings, cause: Cause) -> CalibratedModel:
    """The model with the size of a cause that readings show."""
    model, estimate, covariance = updated(saved, seen, cause)
    return replace(saved, model=model, estimate=estimate, covariance=covariance)


def save_warming(path: Path, fitted: IdentificationFit, std: float, alpha: float = 0.0) -> None:
    """Write the model of a fit with an added growth during warm-up.

    The growth is in 1/K of its end; its standard deviation comes from no reading of the fit.
    """
    save_model(path, fitted)
    save_update(
        path,
        path,
        fitted.model.append(warm_up(fitted.model.robot, 1500.0)),
        np.append(fitted.estimate, alpha),
        np.pad(fitted.covariance, (0, 1)) + np.diag([0.0] * len(fitted.estimate) + [std**2]),
        {"by": "a test"},
    )
