"""Which poses to measure: D-optimal selection from candidates, its bound, and what it will be worth."""

from calib.selection.choose import Choice, choose
from calib.selection.curve import Curve, curve_of
from calib.selection.exchange import select
from calib.selection.indices import Observability, observability
from calib.selection.information import Candidates, Setup, candidates_of

__all__ = [
    "Candidates",
    "Choice",
    "Curve",
    "Observability",
    "Setup",
    "candidates_of",
    "choose",
    "curve_of",
    "observability",
    "select",
]
