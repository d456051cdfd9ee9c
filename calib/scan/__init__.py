"""Scan for effects: the residuals that each candidate would explain in addition to a model."""

from calib.scan.families import Candidate, Harmonics, Shapes, Steps
from calib.scan.scores import Family, Scores, Space

__all__ = ["Candidate", "Family", "Harmonics", "Scores", "Shapes", "Space", "Steps"]
