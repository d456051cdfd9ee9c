"""A model on disk: written with a hash; when it is read, every number is checked against plausible bounds."""

from calib.saved.document import model_document, parameters_of, save_update
from calib.saved.model_file import SIMULATED, CalibratedModel, as_saved, load_model, refuse_worse, save_model

__all__ = [
    "SIMULATED",
    "CalibratedModel",
    "as_saved",
    "load_model",
    "model_document",
    "parameters_of",
    "refuse_worse",
    "save_model",
    "save_update",
]
