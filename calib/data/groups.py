"""The groups of parameters of a base model by their names in `[model] fit`, and the levels."""

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
