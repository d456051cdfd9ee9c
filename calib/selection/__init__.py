"""Selection of D-optimal poses to measure, with a bound and the predicted uncertainty."""

from calib.selection.choose import (
    SHARE,
    STEP,
    WORTH,
    BesideType,
    Choice,
    Curve,
    beside_type,
    choose,
    curve_of,
    observability,
)
from calib.selection.exchange import select
from calib.selection.information import Candidates, Setup, candidates_of
from calib.selection.lengths import Balls, Lengths, uncertainty_of

__all__ = [
    "SHARE",
    "STEP",
    "WORTH",
    "Balls",
    "BesideType",
    "Candidates",
    "Choice",
    "Curve",
    "Lengths",
    "Setup",
    "beside_type",
    "candidates_of",
    "choose",
    "curve_of",
    "observability",
    "select",
    "uncertainty_of",
]
