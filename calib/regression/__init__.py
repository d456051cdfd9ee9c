"""MLS-SVR on positions, or on the residuals of a physical model, with its features."""

from calib.regression.patch import Patch, error_with_patch, error_without_patch, patch_of
from calib.regression.regression import (
    SETS,
    Regression,
    RegressionRequest,
    evaluate,
    flipped,
    independent,
    like_ur,
    products_of,
    usual,
)

__all__ = [
    "SETS",
    "Patch",
    "Regression",
    "RegressionRequest",
    "error_with_patch",
    "error_without_patch",
    "evaluate",
    "flipped",
    "independent",
    "like_ur",
    "patch_of",
    "products_of",
    "usual",
]
