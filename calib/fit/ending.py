"""The ending of a fit's iterations."""

from __future__ import annotations

from enum import StrEnum


class FitTermination(StrEnum):
    """The reason for which a fit ended; `scipy.optimize.least_squares` reports a status and a message."""

    CONVERGED = "converged"  # the last step was a small part of the standard errors
    ROUNDS = "round limit"
    NO_DESCENT = "no descent"

    @property
    def in_words(self) -> str:
        """The predicate of a sentence about the fit."""
        return _IN_WORDS[self]


_IN_WORDS = {
    FitTermination.CONVERGED: "has converged",
    FitTermination.ROUNDS: "still moved when it had taken as many steps as it may",
    FitTermination.NO_DESCENT: "found no step, however short, that makes its error smaller",
}
