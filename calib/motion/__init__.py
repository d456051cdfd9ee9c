"""Alignment of a moving robot: two streams of samples, clocks, rests and path errors."""

from calib.motion.alignment import Aligned, SpeedBandErrors, align, by_speed, split
from calib.motion.poses import SLOW_MM_S, Origin, Standstills, data_set, standstills
from calib.motion.read import read_joints, read_points
from calib.motion.streams import JointStream, PointStream

__all__ = [
    "SLOW_MM_S",
    "Aligned",
    "JointStream",
    "Origin",
    "PointStream",
    "SpeedBandErrors",
    "Standstills",
    "align",
    "by_speed",
    "data_set",
    "read_joints",
    "read_points",
    "split",
    "standstills",
]
