"""Inverse kinematics in closed form, batched, all eight branches by name. `inverse_kinematics` is the door."""

from calib.arm.inverse_kinematics.solutions import BRANCHES, SINGULAR_SINE, Reached, Solutions, branch_index
from calib.arm.inverse_kinematics.solve import inverse_kinematics
from calib.arm.inverse_kinematics.structure import Structure, structure_of
from calib.arm.inverse_kinematics.turns import nearest_branch, nearest_turns, within_limits

__all__ = [
    "BRANCHES",
    "SINGULAR_SINE",
    "Reached",
    "Solutions",
    "Structure",
    "branch_index",
    "inverse_kinematics",
    "nearest_branch",
    "nearest_turns",
    "structure_of",
    "within_limits",
]
