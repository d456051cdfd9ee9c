"""Offsets that a fit found for base targets and tool targets of uncertain position.

Base targets are cups and nests. For a target, the fit gives the offset m and covariance P for its prior
N(0, U). Readings and all other targets together then put it at

    d = U S+ m   with   S = U - P,   and   d' (U S+ U)+ d = m' S+ m  ~  chi-squared

if the uncertainty is as stated. S is the covariance of m over such set-ups, S+ its inverse in the
directions that they see. A target beyond that is reported as doubted. Its prior is then taken away and
the others are judged again without it, so that one cup out of place does not accuse its neighbours.
Source: the test of innovations (Bar-Shalom, Li and Kirubarajan 2001, section 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import chdtrc

from calib.arm.start import align
from calib.array import Array
from calib.fit.identification import IdentificationFit

FALSE_ALARM = 1e-3  # chance that any target of a set is doubted although all are as stated
_SEEN = 1e-3  # share of the prior's variance that the others take away: below it they say nothing
_AS_WELL = 6.0  # chi-squared by which another target may explain less and still be the one: odds of 1 to 20
_SET_FREE = 1e3  # by so much the prior of a doubted target is widened


@dataclass(frozen=True)
class TargetOffsetTest:
    """Judgement of a target: its distance from the stated place according to all the rest.

    Attributes
    ----------
    distance_mm : float
        Distance from the stated place.
    sigma : float
        The distance in standard deviations of such a distance.
    doubted : bool
        Whether the distance is too large for chance.
    rivals : tuple of str
        Targets that would explain the same readings about as well if they were out of place instead.
    """

    distance_mm: float
    sigma: float
    doubted: bool = False
    rivals: tuple[str, ...] = ()

    def in_words(self, what: str, u_mm: float) -> str:
        """Describe something, known to `u_mm` per axis, that is out of place, in a sentence."""
        far = f"{self.distance_mm:.2g} mm ({self.sigma:.0f} sigma)"
        lies = f"{what} lies {far} from where the cell file puts it to {u_mm:g} mm"
        if not self.rivals:
            return f"{lies}: measure it anew."
        rivals = ", ".join(self.rivals)
        return (
            f"{lies}, or else {rivals}, which these readings hardly distinguish from it: measure them anew."
        )


@dataclass(frozen=True)
class TargetOffset:
    """Offset of a target from its stated position, with standard errors.

    Attributes
    ----------
    kind : str
        `base target` or `tool target`.
    offset_mm, std_mm : tuple of float
        x, y, z, if they were free, and their standard errors.
    u_mm : float
        Stated standard uncertainty per axis.
    """

    name: str
    kind: str
    offset_mm: tuple[float, ...]
    std_mm: tuple[float, ...]
    u_mm: float
    judged: TargetOffsetTest

    def in_words(self) -> str:
        """Describe a displaced target in a sentence."""
        return self.judged.in_words(f"{self.kind.capitalize()} {self.name}", self.u_mm)


def offsets_of(found: IdentificationFit) -> tuple[TargetOffset, ...]:
    """List every target whose position was known to an uncertainty, in the order of the model."""
    model = found.model
    of_target: dict[tuple[str, str], list[int]] = {}
    for effect in model.effects:
        if effect.group != "base model" or not effect.places <= {"target", "anchor"}:
            continue
        kind = "base target" if "anchor" in effect.places else "tool target"
        for p in effect.parameters:
            i = model.index[p.name]
            if model.measured[i] and found.covariance[i, i] > 0.0:
                of_target.setdefault((kind, p.name.rpartition(".")[0]), []).append(i)
    if not of_target:
        return ()
    which = np.array([i for those in of_target.values() for i in those])
    rows = np.split(np.arange(len(which)), np.cumsum([len(those) for those in of_target.values()])[:-1])
    u, m, p = model.prior_std[which], found.estimate[which], found.covariance[np.ix_(which, which)]
    # weight of the prior in the fit, relative to the noise found then, not to the noise reported in the end
    then = np.outer(*[found.prior[which] * u] * 2) / max(found.noise_scale, 1.0) ** 2
    judged = _judged(m, then * p, u, rows, [name for _, name in of_target])
    return tuple(
        TargetOffset(
            name,
            kind,
            tuple(m[at].tolist()),
            tuple(np.sqrt(np.diag(p)[at]).tolist()),
            float(u[at].max()),
            one,
        )
        for (kind, name), at, one in zip(of_target, rows, judged, strict=True)
    )


def judge_points(
    points: Array, stated: Array, u_mm: Array, noise: Array, names: list[str]
) -> list[TargetOffsetTest]:
    """Judge points measured in a separate frame against their stated positions.

    With o the offset from the statement, y the points laid over the stated ones, and a frame that is
    free to move by G theta, the model is y = o + G theta + e. It has the weights P = V - V G (G'VG)^-1
    G'V with V = (U + N)^-1, so that m = U P y.

    Parameters
    ----------
    points, stated : array of shape (n, 3)
        Measured and stated points, mm; n >= 3, not in a line.
    u_mm : array of shape (n,)
        Uncertainty of the stated positions, above zero.
    noise : array of shape (n, 3, 3)
        Covariance of each measured point, mm2.
    names : list of str
        Names of the points.
    """
    turn, shift = align(points, stated, np.ones(len(points)))
    y = (points @ turn.T + shift - stated).ravel()
    lever = stated - stated.mean(axis=0)
    frame = np.concatenate(
        [np.tile(np.eye(3), (len(stated), 1, 1)), np.cross(np.eye(3), lever[:, None])], axis=1
    )
    g = frame.swapaxes(1, 2).reshape(-1, 6)
    u = np.repeat(u_mm, 3)
    spread = np.asarray(block_diag(*(turn @ noise @ turn.T)), dtype=np.float64)
    v = np.asarray(np.linalg.inv(np.diag(u**2) + spread), dtype=np.float64)
    p = np.asarray(v - v @ g @ np.linalg.solve(g.T @ v @ g, g.T @ v), dtype=np.float64)
    m, left = u**2 * (p @ y), np.diag(u**2) - np.outer(u**2, u**2) * p
    return _judged(m, left, u, list(np.arange(len(y)).reshape(-1, 3)), names)


def _judged(
    m: Array, p: Array, u: Array, rows: list[NDArray[np.int64]], names: list[str]
) -> list[TargetOffsetTest]:
    """Judge every target; a doubted one no longer counts in the test of the others.

    `m` (k,) and `p` (k, k) are offsets and their covariance, `u` (k,) the standard deviations of the
    priors. `rows` gives the indices of each target.
    """
    out: dict[int, TargetOffsetTest] = {}
    while len(out) < len(rows):
        found = {t: _apart(m[at], p[np.ix_(at, at)], u[at]) for t, at in enumerate(rows) if t not in out}
        worst = min(found, key=lambda t: (found[t][1], -found[t][0].sigma))
        one, chance = found[worst]
        if chance * len(rows) >= FALSE_ALARM:
            out |= {t: other for t, (other, _) in found.items()}
            break
        alike = [
            names[t]
            for t, (other, _) in found.items()
            if t != worst and other.sigma**2 > one.sigma**2 - _AS_WELL
        ]
        out[worst] = replace(one, doubted=True, rivals=tuple(alike))
        at = rows[worst]
        less = np.diag(u[at] ** 2 / (1.0 - _SET_FREE**-2)) - p[np.ix_(at, at)]
        gain = p[:, at] @ np.linalg.inv(less)  # Woodbury: the prior's weight goes down, its mean is zero
        m, p = m + gain @ m[at], p + gain @ p[at]
    return [out[t] for t in range(len(rows))]


def _apart(m: Array, p: Array, u: Array) -> tuple[TargetOffsetTest, float]:
    """Compute the distance at which the others put a target, and its p-value.

    The p-value is the chance of a larger distance if all targets are as stated.
    """
    share, axes = np.linalg.eigh(np.eye(len(u)) - p / np.outer(u, u))
    seen = share > _SEEN
    along = (axes.T @ (m / u))[seen]
    square = float(np.sum(along**2 / share[seen]))
    distance = float(np.linalg.norm(u * (axes[:, seen] @ (along / share[seen]))))
    return TargetOffsetTest(distance, float(np.sqrt(square))), float(chdtrc(max(int(seen.sum()), 1), square))
