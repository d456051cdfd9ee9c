"""Robot calibration from a data set: identify, diagnose, compensate and validate.

The usual sequence is `read_dataset`, `identify`, `save_model`, `correct`. The functions compute with arrays and talk to
no device. Each subpackage exports its public names in its `__init__`. The diagnosis is `calib.diagnose.diagnose`; a
function `diagnose` here would hide the subpackage of that name.
"""

from calib.arm import Robot, forward, inverse_kinematics, load_robot
from calib.compensate import Correction, correct
from calib.data import Dataset, read_dataset
from calib.diagnose import DiagnosisFit
from calib.errors import DataError
from calib.fit import IdentificationFit, identify
from calib.model import StatedConditions
from calib.saved import CalibratedModel, load_model, save_model
from calib.selection import choose
from calib.validation import judge

__all__ = [
    "CalibratedModel",
    "Correction",
    "DataError",
    "Dataset",
    "DiagnosisFit",
    "IdentificationFit",
    "Robot",
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
