"""The common part of robots of a type, learnt from their models: means and spreads that become the next prior."""

from calib.fit.of_type import TypePrior
from calib.prior.file import load_prior, prior_document, save_prior
from calib.prior.lesson import FEWEST, Learnt, Lesson, Outlier, learn
from calib.prior.member import Member

__all__ = [
    "FEWEST",
    "Learnt",
    "Lesson",
    "Member",
    "Outlier",
    "TypePrior",
    "learn",
    "load_prior",
    "prior_document",
    "save_prior",
]
