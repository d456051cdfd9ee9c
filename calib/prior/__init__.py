"""Prior of a robot type: means and spreads of parameters, learned from robots of the type."""

from calib.fit.type_prior import TypePrior
from calib.prior.file import load_prior, prior_document, save_prior
from calib.prior.type_statistics import FEWEST, LearnedParameter, Outlier, TypeMember, TypeStatistics, learn

__all__ = [
    "FEWEST",
    "LearnedParameter",
    "Outlier",
    "TypeMember",
    "TypePrior",
    "TypeStatistics",
    "learn",
    "load_prior",
    "prior_document",
    "save_prior",
]
