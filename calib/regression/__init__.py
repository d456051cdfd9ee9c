"""Regression on positions and on what a physical model leaves of them: MLS-SVR with its features and its choice."""

from calib.regression.features import SETS, evaluate, independent, products_of, usual
from calib.regression.regression import Regression, Wanted

__all__ = ["SETS", "Regression", "Wanted", "evaluate", "independent", "products_of", "usual"]
