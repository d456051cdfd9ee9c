"""Regression on positions, or on the residuals of a physical model: MLS-SVR, its features and their choice."""

from calib.regression.features import SETS, evaluate, independent, products_of, usual
from calib.regression.regression import Regression, Wanted

__all__ = ["SETS", "Regression", "Wanted", "evaluate", "independent", "products_of", "usual"]
