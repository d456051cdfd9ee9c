"""Verdict on a robot that was measured again: unchanged, or what has changed.

The verdict uses the mean over watches with forgetting (MEWMA), of residuals at the same poses against the same
baseline:

    z_i = g r_i + (1 - g) z_(i-1),    z_0 = 0,

here divided by b_i = 1 - (1 - g)^i, so that a lasting change keeps its size. The variance of noise and frame falls to
the share g / (2 - g) (1 - (1 - g)^(2 i)) / b_i^2. The uncertainty of the baseline is the same in every watch and does
not fall. The covariance of each mean is known, so its chi-squared keeps the false-alarm rate at every watch, instead of
an average run length. Source: Lowry et al. 1992.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from calib.array import Array
from calib.effects import check_of
from calib.watch.cause import Cause, fitted
from calib.watch.cause_evidence import Odds
from calib.watch.whitened_readings import WhitenedReadings

WEIGHT = 0.2


@dataclass(frozen=True)
class Mean:
    """Mean residual (q,) of several watches, and the remaining share of the noise variance."""

    residual: Array
    share: float
    watches: int


def mean_of(residuals: Array) -> Mean:
    """Average residuals (i, q), oldest first, whitened by noise."""
    weights = WEIGHT * (1.0 - WEIGHT) ** np.arange(len(residuals))[::-1]
    total = float(np.sum(weights))
    return Mean(weights @ residuals / total, float(np.sum(weights**2)) / total**2, len(residuals))


RATE = 0.01
"""False alarms of an unchanged robot, a watch."""

Kind = Literal["unchanged", "changed", "ambiguous", "unexplained"]


@dataclass(frozen=True)
class ChangeTest:
    """Test of the alarm.

    Attributes
    ----------
    t_squared, limit : float
        T-squared of all rows, and its limit.
    rows : int
        Number of rows.
    p_value, p_limit : float
        Smallest p-value of T-squared and of every cause, and its limit.
    watches : int
        Number of watches that were averaged.
    """

    t_squared: float
    limit: float
    rows: int
    p_value: float
    p_limit: float
    watches: int

    @property
    def alarm(self) -> bool:
        """Whether the test is significant at the stated rate of false alarms."""
        return self.p_value < self.p_limit


@dataclass(frozen=True)
class WatchVerdict:
    """Verdict of a watch.

    Attributes
    ----------
    rate : float
        False-alarm rate of an unchanged robot.
    causes : tuple of (Cause, float)
        Possible causes with their weights, likeliest first.
    left : float or None
        P-value of the residual that the likeliest cause does not explain.
    apart : bool
        Whether other poses could distinguish the possible causes.
    """

    kind: Kind
    rate: float
    questions: tuple[ChangeTest, ...]
    causes: tuple[tuple[Cause, float], ...]
    left: float | None
    apart: bool
    advice: str

    @property
    def cause(self) -> Cause | None:
        """Cause, if exactly one is identified."""
        return self.causes[0][0] if self.kind == "changed" else None

    @property
    def in_words(self) -> str:
        """Verdict as a sentence."""
        if self.kind == "unchanged":
            return f"Nothing has changed that {self.questions[0].rows} values could show."
        if self.kind == "unexplained":
            return "The robot has changed, and no single known cause explains it."
        return " Or: ".join(cause.changed for cause, _ in self.causes)


def judge(seen: WhitenedReadings, before: Sequence[Array] = (), rate: float = RATE) -> WatchVerdict:
    """Decide whether the robot has changed since its baseline.

    Parameters
    ----------
    seen : WhitenedReadings
        Readings of the check poses, whitened for the baseline.
    before : sequence of array of shape (q,), optional
        Residuals of earlier watches at the same poses, whitened by noise, oldest first. Each of the two tests then uses
        half of `rate`.
    rate : float, optional
        False-alarm rate of an unchanged robot.
    """
    share = rate if not len(before) else rate / 2.0
    now = _asked(seen, seen.residual, 1.0, share, 1)
    asked = [now]
    if len(before):
        mean = mean_of(np.vstack([*before, seen.residual]))
        asked.append(_asked(seen, mean.residual, mean.share, share, mean.watches, mean))
    questions = tuple(each.question for each in asked)
    alarmed = next((each for each in asked if each.question.alarm), None)
    if alarmed is None:
        return WatchVerdict("unchanged", rate, questions, (), None, False, "Nothing.")
    return _explained(seen, alarmed, questions, rate)


@dataclass(frozen=True)
class _Asked:
    """Test with its white residual (q,) and the causes that could explain it."""

    question: ChangeTest
    residual: Array
    whiten: Array
    odds: Odds
    mean: Mean | None


def _asked(
    seen: WhitenedReadings, residual: Array, share: float, rate: float, watches: int, mean: Mean | None = None
) -> _Asked:
    whiten, odds = odds_of(seen, share)
    white = whiten @ residual
    p_limit = odds.limit(rate)
    question = ChangeTest(
        float(white @ white),
        float(stats.chi2.isf(p_limit, odds.rows)),
        odds.rows,
        float(odds.p_values(white[None]).min()),
        p_limit,
        watches,
    )
    return _Asked(question, white, whiten, odds, mean)


def odds_of(seen: WhitenedReadings, share: float = 1.0) -> tuple[Array, Odds]:
    """Return the matrix (q, q) that whitens residuals without change, and the possible causes."""
    whiten: Array = np.asarray(np.linalg.inv(np.linalg.cholesky(seen.spread(share))), dtype=np.float64)
    return whiten, Odds.of(seen.causes, [whiten @ columns for columns in seen.columns])


def _explained(
    seen: WhitenedReadings, asked: _Asked, questions: tuple[ChangeTest, ...], rate: float
) -> WatchVerdict:
    odds, white = asked.odds, asked.residual[None]
    mean = None if asked.mean is None else asked.mean.residual
    causes = [fitted(seen, column.effect, asked.whiten, mean) for column in odds.causes]
    # the linear evidence for shifts alone and for physical bounds is added to that of the fits
    linear = np.array([column.whole(white)[0] for column in odds.causes])
    allowed = np.isfinite(linear)
    beside = np.where(allowed, odds.evidence(white)[0] - np.where(allowed, linear, 0.0), -np.inf)
    evidence = np.array([cause.evidence for cause in causes]) + beside
    named = odds.by(white, evidence[None], np.array([[cause.gain for cause in causes]]))
    best, weights = int(named.best[0]), named.weights[0]
    ranked = sorted(np.flatnonzero(weights), key=lambda c: (-weights[c], c != best))
    members = tuple((causes[c], float(weights[c])) for c in ranked)
    likeliest = members[0][0]
    left = float(
        stats.chi2.sf(float(likeliest.left @ likeliest.left), odds.rows - odds.causes[ranked[0]].freedom)
    )
    twins = set(odds.always(best))
    apart = any(c != best and c not in twins for c in ranked)
    if left < rate:
        kind: Kind = "unexplained"
    else:
        kind = "changed" if bool(named.alone[0]) else "ambiguous"
    return WatchVerdict(kind, rate, questions, members, left, apart, _advice(kind, members, apart=apart))


def _advice(kind: Kind, members: Sequence[tuple[Cause, float]], *, apart: bool) -> str:
    if kind == "changed":
        return members[0][0].remedy
    if kind == "unexplained":
        return "Measure again; where it stays, recalibrate. Make sure that this is the robot of the model."
    looked_at = " ".join(check_of(cause.label) for cause, _ in members)
    if apart:
        return f"Measure again with more poses, which can tell these apart. {looked_at}"
    return f"No poses tell these apart; look. {looked_at}"
