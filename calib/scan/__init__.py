"""The scan: how much of the residuals each candidate effect would explain in addition to a fitted model."""

from calib.scan.families import Candidate, Harmonics, Shapes, Steps
from calib.scan.scores import Family, Scores, Space

__all__ = ["Candidate", "Family", "Harmonics", "Scores", "Shapes", "Space", "Steps"]
