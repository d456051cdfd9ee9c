"""Sweeps: what single joints show of themselves while they alone turn."""

from calib.sweeps.joint import AxisDifference, JointSweep, analyse

__all__ = ["AxisDifference", "JointSweep", "analyse"]
