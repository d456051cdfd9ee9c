"""Robot files: written, imported, described, and checked against a few readings."""

from calib.robot_file.description import Described, axes_of, described
from calib.robot_file.dh_import import import_dh
from calib.robot_file.draft import CONVENTIONS, Convention, Draft, DraftLink, weighed, written_robot
from calib.robot_file.misread import (
    CheckReadings,
    RobotFileMistake,
    RobotFileVerdict,
    held_against,
    read_handful,
)
from calib.robot_file.schema import SCHEMA
from calib.robot_file.serial_chain import chain_of
from calib.robot_file.urdf import urdf_of
from calib.robot_file.urdf_import import Imported, import_urdf, in_words

__all__ = [
    "CONVENTIONS",
    "SCHEMA",
    "CheckReadings",
    "Convention",
    "Described",
    "Draft",
    "DraftLink",
    "Imported",
    "RobotFileMistake",
    "RobotFileVerdict",
    "axes_of",
    "chain_of",
    "described",
    "held_against",
    "import_dh",
    "import_urdf",
    "in_words",
    "read_handful",
    "urdf_of",
    "weighed",
    "written_robot",
]
