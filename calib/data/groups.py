"""Groups of parameters that a data set may ask a base model to free, as `[model] fit` names them, and the levels."""

from __future__ import annotations

GROUPS = (
    "base",
    "geometry",
    "parallel_twist",
    "compliance",
    "tool",
    "joint_offsets",
    "encoder_scale",
    "length_zero",
)
DEFAULT_GROUPS = ("base", "geometry", "parallel_twist", "compliance")
LEVELS = {
    1: ("base", "joint_offsets", "encoder_scale"),
    2: ("base", "geometry", "parallel_twist"),
    3: DEFAULT_GROUPS,
}
"""Levels of calibration: 1 joints, 2 geometry, 3 what is not geometry too. Source: Roth, Mooring and Ravani 1987."""
