"""Sweeps: the errors of a single joint, measured while only that joint turns."""

from calib.sweeps.joint import JointSweep, analyse

__all__ = ["JointSweep", "analyse"]
