"""Robot files: written, imported, described, and held against a few readings."""

from calib.robot_file.described import Described, axes_of, described
from calib.robot_file.draft import CONVENTIONS, Convention, Draft, DraftLink, written_robot
from calib.robot_file.import_dh import import_dh
from calib.robot_file.import_urdf import Imported, import_urdf, in_words
from calib.robot_file.schema import SCHEMA

__all__ = [
    "CONVENTIONS",
    "SCHEMA",
    "Convention",
    "Described",
    "Draft",
    "DraftLink",
    "Imported",
    "axes_of",
    "described",
    "import_dh",
    "import_urdf",
    "in_words",
    "written_robot",
]
