"""Measurements as users export them: one true campaign (`case`) as texts and workbooks."""

from tests.calib.exports import books, texts
from tests.calib.exports.case import CASES, ROBOT, TRUTH, Case, N, outcome

__all__ = ["CASES", "ROBOT", "TRUTH", "Case", "N", "books", "outcome", "texts"]
