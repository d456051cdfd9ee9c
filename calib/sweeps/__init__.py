"""Sweeps: the errors of a single joint, measured while only that joint turns."""

from calib.sweeps.joint import AxisDifference, JointSweep, analyse

__all__ = ["AxisDifference", "JointSweep", "analyse"]
