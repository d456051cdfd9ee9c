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
from calib.selection.sequential import (
    Design,
    Misses,
    WorkingZone,
    bound,
    expected_rms,
    least_bound,
    misses,
    rows_of_visits,
    usual_covariance,
    zone_of,
)

__all__ = [
    "SHARE",
    "STEP",
    "WORTH",
    "Balls",
    "BesideType",
    "Candidates",
    "Choice",
    "Curve",
    "Design",
    "Lengths",
    "Misses",
    "Setup",
    "WorkingZone",
    "beside_type",
    "bound",
    "candidates_of",
    "choose",
    "curve_of",
    "expected_rms",
    "least_bound",
    "misses",
    "observability",
    "rows_of_visits",
    "select",
    "uncertainty_of",
    "usual_covariance",
    "zone_of",
]
