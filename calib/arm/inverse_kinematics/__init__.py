"""Inverse kinematics, batched, all branches by name. Callers use `inverse_kinematics`.

In closed form: six axes with a wrist in a point or three parallel axes (UR), SCARA, palletizers and five axes, seven
axes with shoulder and wrist in a point. By a search over one joint: wrists that are not in a point. On a track each.
"""

from calib.arm.inverse_kinematics.solutions import (
    BRANCHES,
    SINGULAR_SINE,
    BranchResult,
    Solutions,
    nominal_inverse,
)
from calib.arm.inverse_kinematics.solve import InvertibleArm, arm_of, inverse_kinematics
from calib.arm.inverse_kinematics.turns import nearest_branch, nearest_turns, within_limits

__all__ = [
    "BRANCHES",
    "SINGULAR_SINE",
    "BranchResult",
    "InvertibleArm",
    "Solutions",
    "arm_of",
    "inverse_kinematics",
    "nearest_branch",
    "nearest_turns",
    "nominal_inverse",
    "within_limits",
]
