"""Sweeps: what single joints show of themselves while they alone turn."""

from calib.sweeps.joint import JointSweep, analyse

__all__ = ["JointSweep", "analyse"]
