"""Inverse kinematics in closed form, batched, all eight branches by name. `inverse_kinematics` is the door."""

from calib.inverse_kinematics.solutions import BRANCHES, SINGULAR_SINE, Reached, Solutions, branch_index
from calib.inverse_kinematics.solve import inverse_kinematics
from calib.inverse_kinematics.structure import Structure, structure_of
from calib.inverse_kinematics.turns import all_turns, nearest_turns

__all__ = [
    "BRANCHES",
    "SINGULAR_SINE",
    "Reached",
    "Solutions",
    "Structure",
    "all_turns",
    "branch_index",
    "inverse_kinematics",
    "nearest_turns",
    "structure_of",
]
