"""The scan: how much of the residuals each candidate effect would explain in addition to a fitted model."""

from calib.scan.fixed import Candidate
from calib.scan.harmonics import Harmonics
from calib.scan.scores import Family, Scores
from calib.scan.shapes import Shapes
from calib.scan.space import Space
from calib.scan.steps import Steps

__all__ = ["Candidate", "Family", "Harmonics", "Scores", "Shapes", "Space", "Steps"]
