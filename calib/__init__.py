"""Calibration: numbers in, numbers out. `read_dataset`, then `identify`, then `save_model` and `correct`.

Every room has a face of its own, from `calib.text` at the bottom to `calib.comparison` at the top. The diagnosis is in
`calib.diagnose`: a function of that name here would hide its room.
"""

from calib.arm import Robot, forward, inverse_kinematics, load_robot
from calib.compensate import Correction, correct
from calib.data import Dataset, read_dataset
from calib.diagnose import Diagnosis
from calib.errors import DataError
from calib.fit import Identification, identify
from calib.model import StatedConditions
from calib.saved import SavedModel, load_model, save_model
from calib.selection import choose
from calib.validation import judge

__all__ = [
    "Correction",
    "DataError",
    "Dataset",
    "Diagnosis",
    "Identification",
    "Robot",
    "SavedModel",
    "StatedConditions",
    "choose",
    "correct",
    "forward",
    "identify",
    "inverse_kinematics",
    "judge",
    "load_model",
    "load_robot",
    "read_dataset",
    "save_model",
]
