"""Model files: written with a hash, and checked against plausible bounds when read."""

from calib.saved.document import model_document, parameters_of, save_update
from calib.saved.model_checks import refuse_other_table
from calib.saved.model_file import SIMULATED, CalibratedModel, as_saved, load_model, refuse_worse, save_model

__all__ = [
    "SIMULATED",
    "CalibratedModel",
    "as_saved",
    "load_model",
    "model_document",
    "parameters_of",
    "refuse_other_table",
    "refuse_worse",
    "save_model",
    "save_update",
]
