"""Comparison of regression and identification on the same readings, in one table."""

from calib.comparison.comparison import (
    DIAGNOSIS,
    NOMINAL,
    TURN,
    ComparisonRequest,
    RegressionComparison,
    Scored,
    TurnedPostureTest,
    away,
    compare,
    mae,
    rmse,
)

__all__ = [
    "DIAGNOSIS",
    "NOMINAL",
    "TURN",
    "ComparisonRequest",
    "RegressionComparison",
    "Scored",
    "TurnedPostureTest",
    "away",
    "compare",
    "mae",
    "rmse",
]
