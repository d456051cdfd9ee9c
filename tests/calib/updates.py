"""A saved model updated in memory, as `truepose watch --update` writes it to a file."""

from __future__ import annotations

from dataclasses import replace

from calib.saved import SavedModel
from calib.watch import Seen, updated
from calib.watch.cause import Cause


def as_updated(saved: SavedModel, seen: Seen, cause: Cause) -> SavedModel:
    """The model with the size of a cause that readings show."""
    model, estimate, covariance = updated(saved, seen, cause)
    return replace(saved, model=model, estimate=estimate, covariance=covariance)
