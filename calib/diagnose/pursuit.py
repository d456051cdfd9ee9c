"""Orthogonal matching pursuit of carried terms, with cross-validation of their number.

1. Screening: one pursuit on at most 1,200 readings keeps the best entries of every step. All later work uses the Gram
   matrices of these entries, one for each of 8 blocks of whole poses, so that its cost does not grow with the readings.
2. Price: the score of an entry is its gain divided by the noise, less log(rows) for each further column, less 2 log(k)
   for k entries of its kind.
3. Number: each fold chooses again from the blocks that it keeps and predicts the one that it leaves out. The fewest
   terms within half a standard error of the best are taken. No term is taken unless the first terms are beyond chance,
   corrected for all entries (Bonferroni), the gain exceeds 2.5 standard errors of the folds, and there are at least 60
   poses. Last terms that are not beyond chance are removed again.
4. Size: every term is shrunk by its evidence (MacKay 1992).
5. Ridge: a ridge of 3 % of a column ties the model to its own fit in directions that a fold does not determine.

The covariance is multiplied by the mean square of the standardised errors of the folds, if that is above 1.
Sources: Pati et al. 1993 (pursuit), Breiman et al. 1984 (one standard error), Roberts et al. 2017 (whole blocks).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import fdtrc

from calib.array import Array
from calib.data.conditions import Conditions
from calib.diagnose.dictionary import Dictionary, Entry, Part
from calib.fit.identification import IdentificationFit
from calib.fit.readings import FitReadings
from calib.model.effect import Effect
from calib.scan.scores import gain_of

MOST_TERMS = 120
FOLDS = 8
FEWEST_POSES = 60
_DEALS = 4  # stretches of the campaign that are dealt to each fold
_PATIENCE = 12  # terms without a smaller error after which a fold stops
LEASH = 0.03  # ridge that ties the model to its own fit, as a share of a column
_SCREENED, _TOP = 1200, 60
_MOST_COLUMNS = 1400  # columns of the Gram matrices
_GATE, _WITHIN = 2.5, 0.5  # standard errors of the folds: of the gain, and from the best number of terms
_CHANCE = 0.01  # probability of a first term by chance, and of a last term by chance
_FAR_BEYOND = 1e-6  # probability by chance below which a last term needs little gain
_PER_ROUND = 6  # entries that enter in one round of the screening
_WORTH = 0.3  # least score of these entries, as a share of the best score
_INDEPENDENT = 0.1  # largest share that an entry may have in common with the others of its round
_LOST = 1e-6  # share of a column that is lost to rounding
_ABSORBED = 0.02  # share of a column that the model must not absorb
_ROUNDS = 30  # rounds of the evidence
_LEAST = 1e-12  # added share of the diagonal that makes a Gram matrix invertible despite rounding
HOLDS = 1e-3  # chance, all entries counted, below which a name holds together with the other chosen entries
_FAVOUR = 3.0  # nats that a name has over a column that does the same


class Pursuit:
    """Pursuit on a Gram matrix (D, D) and right side (D,).

    The first `count` columns are the model's. Left-out readings, given by columns (r, D) and residual (r,), take no
    part; `missed` is their remaining error.
    """

    def __init__(
        self,
        gram: Array,
        right: Array,
        square: float,
        rows: int,
        groups: Groups,
        left_out: tuple[Array, Array] | None = None,
    ) -> None:
        self.gram, self.rows, self.groups, count = gram, rows, groups, groups.count
        self.whole, self.chosen, self.free = np.diag(gram).copy(), list[int](), rows - count
        room = count + int(np.sort(groups.width)[-MOST_TERMS:].sum())
        self._basis = np.zeros((room, len(gram)))
        lower = np.linalg.cholesky(gram[:count, :count])
        self._basis[:count] = solve_triangular(lower, gram[:count], lower=True)
        share = solve_triangular(lower, right[:count], lower=True)
        self._used = count
        self.own = np.maximum(self.whole - np.sum(self._basis[:count] ** 2, axis=0), 0.0)
        i, j = groups.pairs
        self.cross = gram[i, j] - np.sum(self._basis[:count, i] * self._basis[:count, j], axis=0)
        self.right = right - share @ self._basis[:count]
        self.rss = square - float(share @ share)
        self.missed = np.zeros(0)
        if left_out is not None:
            self._columns, residual = left_out
            self._there = np.zeros((len(residual), room))
            self._there[:, :count] = solve_triangular(lower, self._columns[:, :count].T, lower=True).T
            self.missed = residual - self._there[:, :count] @ share

    def _enter(self, i: int) -> None:
        if self.own[i] <= _LOST * self.whole[i]:
            return
        k, size = self._used, np.sqrt(self.own[i])
        before = self._basis[:k, i]
        direction = (self.gram[i] - before @ self._basis[:k]) / size
        share = float(self.right[i] / size)
        self._basis[k], self._used = direction, k + 1
        self.right = self.right - share * direction
        self.own = np.maximum(self.own - direction**2, 0.0)
        one, other = self.groups.pairs
        self.cross = self.cross - direction[one] * direction[other]
        self.rss -= share**2
        self.free -= 1
        if len(self.missed):
            self._there[:, k] = (self._columns[:, i] - self._there[:, :k] @ before) / size
            self.missed = self.missed - share * self._there[:, k]

    def step(self) -> bool:
        """Let the best entry enter; return False if no entry has anything left to explain."""
        noise = self.rss / max(self.free, 1)
        score = self.groups.scores(
            self.own, self.cross, self.right, self.whole, noise, self.rows, self.chosen
        )
        best = int(np.argmax(score))
        if not np.isfinite(score[best]):
            return False
        columns = self.groups.of(best)
        for i in range(columns.start, columns.stop):
            self._enter(i)
        self.chosen.append(best)
        return True

    def columns(self, terms: int) -> NDArray[np.int64]:
        """Return the columns of the model and those of the first `terms` terms."""
        own = [np.arange(len(self.gram))[self.groups.of(g)] for g in self.chosen[:terms]]
        return np.concatenate([np.arange(self.groups.count), *own]).astype(np.int64)


class Groups:
    """Entries of a pursuit as groups of columns, after the `count` columns of the model.

    The arrays `own` and `right` of `scores` contain, for every column after projection, its square and its product with
    the data. The array `cross` (pairs,) contains the products of columns of one entry.
    """

    def __init__(self, width: NDArray[np.int64], price: Array, named: NDArray[np.bool_], count: int) -> None:
        self.width, self.price, self.named, self.count = width, price, named, count
        self.first = count + np.r_[0, np.cumsum(width)[:-1]].astype(int)
        self.of_width = {int(w): np.flatnonzero(width == w) for w in np.unique(width)}
        pairs = [
            np.column_stack([self.first[of] + i, self.first[of] + j])
            for w, of in self.of_width.items()
            for i in range(w)
            for j in range(i)
        ]
        self.pairs = np.vstack([*pairs, np.zeros((0, 2), int)]).T

    def of(self, entry: int) -> slice:
        """Return the columns of an entry."""
        return slice(self.first[entry], self.first[entry] + self.width[entry])

    def scores(
        self, own: Array, cross: Array, right: Array, whole: Array, noise: float, rows: int, chosen: list[int]
    ) -> Array:
        """Compute the score (entries,) of each entry.

        It is -inf for entries that are chosen already, or that have nothing left.
        """
        gain, at = np.zeros(len(self.width)), 0
        for w, of in self.of_width.items():
            columns = self.first[of][:, None] + np.arange(w)
            gram = np.zeros((len(of), w, w))
            gram[:, range(w), range(w)] = own[columns]
            for i in range(w):
                for j in range(i):
                    gram[:, i, j] = gram[:, j, i] = cross[at : at + len(of)]
                    at += len(of)
            raw = np.maximum(whole[columns], 1e-300)
            free = gain_of(gram, right[columns], raw)[0]
            held = gain_of(gram, right[columns], raw, _ABSORBED)[0]
            gain[of] = np.where(self.named[of], free, held)
        score = np.where(
            gain > 0.0, gain / noise - (self.width - 1) * np.log(rows) - 2.0 * self.price, -np.inf
        )
        score[chosen] = -np.inf
        return score


def log_chance(before: float, after: float, columns: int, free: int) -> float:
    """Compute the log of the chance that meaningless columns reduce the sum of squares as much."""
    columns, free = max(columns, 1), max(free, 1)
    ratio = (before - after) / columns / max(after / free, 1e-300)
    chance = float(fdtrc(columns, free, max(ratio, 0.0)))
    # on underflow, use the formula for two columns, which is exact for two
    return float(np.log(chance)) if chance > 1e-290 else -0.5 * free * float(np.log1p(columns * ratio / free))


class Screening:
    """Pursuit on rows, with several entries per round.

    The columns (D, m) are in single precision and become unit vectors. The basis of the model is orthonormal. All
    entries of a round share one pass through the many columns.
    """

    def __init__(self, columns: Array, basis: Array, left: Array, groups: Groups, rows: int) -> None:
        # The square of a cubed torque overflows in single precision
        size = np.sqrt(np.einsum("ij,ij->i", columns, columns, dtype=np.float64))
        columns /= np.where(size > 0.0, size, 1.0)[:, None]
        self.columns, self.basis, self.left, self.groups = columns, basis, left, groups
        self.rows, self.free, self.rss = rows, rows - basis.shape[1], float(left @ left)
        self.chosen: list[int] = []
        self.whole = np.where(size > 0.0, 1.0, 0.0)
        shared = self._shared(basis)
        self.own = self.whole - np.einsum("ij,ij->i", shared, shared)
        i, j = groups.pairs
        self.cross = np.einsum("ij,ij->i", columns[i], columns[j]).astype(float)
        self.cross -= np.einsum("ij,ij->i", shared[i], shared[j])
        self.right = self._shared(left[:, None])[:, 0]

    def _shared(self, vectors: Array) -> Array:
        """Compute the products (D, c) of the columns with vectors (m + priors, c)."""
        return (self.columns @ vectors[: self.columns.shape[1]].astype(np.float32)).astype(float)

    def round(self) -> tuple[NDArray[np.int64], list[float]]:
        """Let the best entries enter that are nearly independent of one another.

        Returns the entries near the best, and the log of the chance of each that entered.
        """
        noise = self.rss / max(self.free, 1)
        score = self.groups.scores(
            self.own, self.cross, self.right, self.whole, noise, self.rows, self.chosen
        )
        ranked = np.argsort(-score, kind="stable")[:_TOP]
        ranked = ranked[np.isfinite(score[ranked])]
        chance: list[float] = []
        new: list[Array] = []
        for best in ranked.tolist():
            if len(self.chosen) == MOST_TERMS or len(chance) == _PER_ROUND:
                break
            if chance and score[best] < _WORTH * score[ranked[0]]:
                break
            directions = np.zeros((len(self.left), self.groups.width[best]))
            directions[: self.columns.shape[1]] = self.columns[self.groups.of(best)].T
            size = np.linalg.norm(directions, axis=0)
            for _ in range(2):
                directions -= self.basis @ (self.basis.T @ directions)
            directions, s, _ = np.linalg.svd(directions / np.maximum(size, 1e-300), full_matrices=False)
            directions = directions[:, s > 1e-6]
            # An entry that shares much with one of this round had its score before that entered
            kept = sum(float(np.sum((directions.T @ other) ** 2)) for other in new)
            if kept > _INDEPENDENT * directions.shape[1] or not directions.shape[1]:
                continue
            share = directions.T @ self.left
            before, self.rss = self.rss, self.rss - float(share @ share)
            self.left = self.left - directions @ share
            self.basis = np.column_stack([self.basis, directions])
            self.free -= len(share)
            self.chosen.append(best)
            new.append(directions)
            chance.append(log_chance(before, self.rss, len(share), self.free))
        if new:
            shared = self._shared(np.column_stack([*new, self.left]))
            self.own = self.own - np.sum(shared[:, :-1] ** 2, axis=1)
            i, j = self.groups.pairs
            self.cross = self.cross - np.einsum("ij,ij->i", shared[i, :-1], shared[j, :-1])
            self.right = shared[:, -1]
        return ranked, chance


@dataclass(frozen=True)
class PursuitTerm:
    """Entry that a pursuit chose.

    Attributes
    ----------
    sizes : tuple of float
        Standard deviation of each column by evidence, internal units.
    explained : float
        Decrease of the sum of squares when the entry entered.
    log_p : float
        Log of the chance of its additional explanation after all others, corrected for the number of entries.
    confirmed : bool
        Whether left-out blocks confirm the entry; otherwise it is only significant.
    """

    entry: Entry
    sizes: tuple[float, ...]
    explained: float
    log_p: float
    confirmed: bool


@dataclass(frozen=True)
class PursuitResult:
    """Choice of a pursuit, in the order of entry.

    Attributes
    ----------
    clock : str
        Clock of its functions of time.
    kappa : float
        Ratio of the errors on left-out blocks to their expectation, at least 1.
    """

    choices: tuple[PursuitTerm, ...] = ()
    clock: str = "time"
    kappa: float = 1.0

    def carried(self, named: Collection[str] = ()) -> tuple[PursuitTerm, ...]:
        """Return the confirmed entries, without the named effects with the given labels."""
        return tuple(
            c
            for c in self.choices
            if c.confirmed and (c.entry.effect is None or c.entry.effect.label not in named)
        )


def folds_of(readings: FitReadings, clock: str) -> NDArray[np.int64]:
    """Assign each reading to a fold, shape (n,).

    Short stretches of whole poses, in the order of their first visit, are dealt out to the folds.
    """
    pose, times = readings.conditions.pose, getattr(readings.conditions, clock)
    first = np.full(int(pose.max()) + 1, np.inf)
    np.minimum.at(first, pose, times)
    seen = np.isfinite(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(np.where(seen, first, np.inf), kind="stable")] = np.arange(len(first))
    return rank[pose] * (FOLDS * _DEALS) // int(seen.sum()) % FOLDS


def pursue(
    found: IdentificationFit, readings: FitReadings, everywhere: Conditions, named: Sequence[Effect] = ()
) -> PursuitResult:
    """Choose the entries that left-out blocks confirm in addition to the model of a fit.

    The result is empty if no number of terms pays.

    Parameters
    ----------
    readings : FitReadings
        Readings that take part, possibly more than those of the fit.
    everywhere : Conditions
        Conditions of all rows that must be predicted.
    named : sequence of Effect
        Effects that compete as entries. They are also chosen beyond the confirmed number while they are significant.
    """
    nothing = PursuitResult()
    poses = len(np.unique(readings.conditions.pose))
    if poses < FEWEST_POSES:
        return nothing
    dictionary = Dictionary.of(found.model, readings, everywhere, named)
    price = dictionary.price - 0.5 * _FAVOUR * dictionary.named
    model = _Model.of(found, readings)
    near, most, log_first = _screened(found, readings, dictionary, price, model)
    if not len(near) or log_first >= np.log(_CHANCE):
        return nothing
    return _decided(found, readings, dictionary, price, model, near, most)


@dataclass(frozen=True)
class _Model:
    """Active columns of the model: mask (m,), sizes (a,), pseudo-rows of priors."""

    active: NDArray[np.bool_]
    size: Array
    prior: Array  # (a,) weight of the prior, in scaled columns
    pull: Array  # (a,) what the priors still miss, weighted

    @classmethod
    def of(cls, found: IdentificationFit, readings: FitReadings) -> _Model:
        active = np.diag(found.covariance) > 0.0
        square = np.zeros(int(active.sum()))
        for part in parts(found, readings):
            square += np.sum(part.columns[:, active] ** 2, axis=0)
        prior = found.prior[active]
        size = np.sqrt(square + prior**2)
        size[size == 0.0] = 1.0
        pull = -(found.prior * (found.estimate - found.model.prior_mean))[active]
        return cls(active, size, prior / size, pull)

    def rows(self, part: Part) -> Array:
        """Return the scaled columns (size, a) of some readings."""
        return part.columns[:, self.active] / self.size


_AT_ONCE = 1200


def parts(found: IdentificationFit, readings: FitReadings) -> list[Part]:
    """Split the readings into parts of whole poses."""
    pose = readings.conditions.pose
    count = max(-(-len(pose) // _AT_ONCE), 1)
    number = np.unique(pose, return_inverse=True)[1].reshape(-1)
    part = number * count // (int(number.max()) + 1)
    return [
        Part(found.model, found.estimate, readings.taken(np.flatnonzero(part == p))) for p in range(count)
    ]


def _screened(
    found: IdentificationFit, readings: FitReadings, dictionary: Dictionary, price: Array, model: _Model
) -> tuple[NDArray[np.int64], int, float]:
    """Screen the entries.

    Returns the entries near the best of every step, the number of worthwhile steps, and the smallest log p of the
    first.
    """
    n = len(readings.rows)
    some = np.unique(np.linspace(0, n - 1, min(n, _SCREENED)).astype(int))
    part = Part(found.model, found.estimate, readings.taken(some))
    known = dictionary.known(readings.conditions)
    columns = part.of_entries(dictionary.entries, known, dictionary.clock, np.float32)
    count = len(model.size)
    stacked = np.vstack([model.rows(part), np.diag(model.prior), LEASH * np.eye(count)])
    u, s, _ = np.linalg.svd(stacked, full_matrices=False)
    basis = u[:, s > 1e-7 * s[0]]
    left = np.r_[part.residual.ravel(), model.pull, np.zeros(count)]
    left = left - basis @ (basis.T @ left)
    groups = Groups(dictionary.width, price, dictionary.named, 0)
    state = Screening(columns, basis, left, groups, part.readings.observed.count)
    near: dict[int, None] = {}
    chance: list[float] = []
    while len(chance) < MOST_TERMS and (len(chance) < 6 or min(chance[-6:]) < np.log(0.5)):
        ranked, found_now = state.round()
        if not found_now:
            break
        near |= dict.fromkeys(ranked.tolist())
        chance += [log_p + np.log(len(dictionary.entries)) for log_p in found_now]
    kept: list[int] = []
    room = _MOST_COLUMNS
    for i in (*state.chosen, *(i for i in near if i not in set(state.chosen))):
        if room >= dictionary.width[i]:
            kept.append(i)
            room -= int(dictionary.width[i])
    return np.array(sorted(kept), dtype=np.int64), len(chance), min(chance[:3], default=0.0)


def _decided(
    found: IdentificationFit,
    readings: FitReadings,
    dictionary: Dictionary,
    price: Array,
    model: _Model,
    near: NDArray[np.int64],
    most: int,
) -> PursuitResult:
    entries = [dictionary.entries[i] for i in near]
    width, count, clock = dictionary.width[near], len(model.size), dictionary.clock
    groups = Groups(width, price[near], dictionary.named[near], count)
    fold = folds_of(readings, clock)
    known = dictionary.known(readings.conditions)
    size = count + int(width.sum())
    gram, right, square = np.zeros((FOLDS, size, size)), np.zeros((FOLDS, size)), np.zeros(FOLDS)
    rows = np.zeros(FOLDS, dtype=np.int64)
    left_out: list[tuple[Array, Array]] = []
    for f in range(FOLDS):
        own = readings.taken(np.flatnonzero(fold == f))
        seen_by_others = dictionary.known(readings.conditions.take(fold != f))
        rows[f] = own.observed.count
        missed, targets = [], []
        for part in parts(found, own):
            base = model.rows(part)
            columns = np.column_stack([base, part.of_entries(entries, known, clock).T])
            left = part.residual.ravel()
            gram[f] += columns.T @ columns
            right[f] += columns.T @ left
            square[f] += left @ left
            known_less = columns
            timed = [i for i, e in enumerate(entries) if e.kind in ("time", "late air")]
            if timed:
                known_less = columns.copy()
                at = np.concatenate([np.arange(size)[groups.of(i)] for i in timed])
                known_less[:, at] = part.of_entries([entries[i] for i in timed], seen_by_others, clock).T
            missed.append(known_less.astype(np.float32))
            targets.append(left)
        left_out.append((np.vstack(missed), np.concatenate(targets)))
    held = np.zeros((size, size))
    held[:count, :count] = np.diag(model.prior**2) + LEASH**2 * np.eye(count)
    toward = np.zeros(size)
    toward[:count] = model.prior * model.pull
    pulled = float(model.pull @ model.pull)
    whole, whole_right = gram.sum(axis=0) + held, right.sum(axis=0) + toward

    def begin(f: int | None) -> Pursuit:
        if f is None:
            return Pursuit(whole, whole_right, square.sum() + pulled, int(rows.sum()), groups)
        return Pursuit(
            whole - gram[f],
            whole_right - right[f],
            square.sum() - square[f] + pulled,
            int(rows.sum() - rows[f]),
            groups,
            left_out[f],
        )

    errors, pursuits = [], []
    for f in range(FOLDS):
        pursuit = begin(f)
        row = [float(pursuit.missed @ pursuit.missed)]
        while len(row) <= most and len(row) - 1 - int(np.argmin(row)) < _PATIENCE and pursuit.step():
            row.append(float(pursuit.missed @ pursuit.missed))
        errors.append(row)
        pursuits.append(pursuit)
    longest = max(map(len, errors))
    table = np.array([row + [row[-1]] * (longest - len(row)) for row in errors])
    best = int(table.sum(axis=0).argmin())
    worse = table - table[:, [best]]
    terms = int(np.flatnonzero(worse.mean(axis=0) <= _WITHIN * _standard_error(worse))[0])
    pays = table[:, 0] - table[:, terms]
    if not terms or pays.mean() <= _GATE * _standard_error(pays):
        return PursuitResult()
    missed = []
    for f, pursuit in enumerate(pursuits):
        columns, left = left_out[f]
        at = pursuit.columns(terms)
        widths = [int(width[g]) for g in pursuit.chosen[:terms]]
        few = pursuit.gram[np.ix_(at, at)]
        value, covariance, noise, _ = shrunk(
            few, (whole_right - right[f])[at], square.sum() - square[f] + pulled, pursuit.rows, count, widths
        )
        seen = columns[:, at]
        spread = noise + np.einsum("ij,jk,ik->i", seen, covariance, seen, optimize=True)
        missed.append((left - seen @ value) ** 2 / spread)
    measured = float(rows.sum()) / sum(len(left) for _, left in left_out)
    kappa = max(1.0, float(np.sqrt(np.mean(np.concatenate(missed)) / measured)))
    pursuit, gains = begin(None), list[float]()
    chances = list[float]()
    tries = np.log(len(dictionary.entries))
    while len(pursuit.chosen) < most:  # only named effects justify terms beyond the confirmed ones
        before, free = pursuit.rss, pursuit.free
        if not pursuit.step():
            break
        chance = log_chance(before, pursuit.rss, free - pursuit.free, pursuit.free) + tries
        chances.append(chance)
        if len(pursuit.chosen) > terms and (chance > np.log(HOLDS) or not any(e.effect for e in entries)):
            pursuit.chosen.pop()
            break
        gains.append(float(before - pursuit.rss))
    surest = _surest(
        table, [entries[g].effect is not None for g in pursuit.chosen[:terms]], np.array(chances)
    )
    at = pursuit.columns(len(pursuit.chosen))
    widths = [int(width[g]) for g in pursuit.chosen]
    few, few_right = whole[np.ix_(at, at)], whole_right[at]
    _, _, noise, precision = shrunk(few, few_right, square.sum() + pulled, pursuit.rows, count, widths)
    inverse = np.linalg.inv(few + _LEAST * np.diag(np.diag(few)))
    plain, free, place = inverse @ few_right, max(pursuit.rows - len(at), 1), count
    left = square.sum() + pulled - float(plain @ few_right)
    choices = []
    for rank, (g, w) in enumerate(zip(pursuit.chosen, widths, strict=True)):
        own = slice(place, place + w)
        alone = float(plain[own] @ np.linalg.solve(inverse[own, own], plain[own]))
        log_p = log_chance(left + alone, left, w, free) + tries
        sizes = tuple(np.sqrt(noise / precision[own]).tolist())
        choices.append(PursuitTerm(entries[g], sizes, gains[rank], log_p, rank < surest))
        place += w
    return PursuitResult(tuple(choices), clock, kappa)


def _surest(table: Array, named: list[bool], chance: Array) -> int:
    """Count the confirmed terms that are also beyond chance.

    Terms after the last named effect were chosen for their own sake. They must pay for themselves or be far beyond
    chance. The table (folds, terms) contains squared errors on left-out blocks, `named` marks named effects, and
    `chance` is the log p of each term.
    """
    names = max((i + 1 for i, name in enumerate(named) if name), default=0)
    for gate, beyond in ((_GATE, _CHANCE), (1.0, _FAR_BEYOND)):
        sure = np.flatnonzero(chance[: len(named)] < np.log(beyond))
        last = int(sure[-1]) + 1 if len(sure) else 0
        pays = table[:, min(names, last)] - table[:, last]
        if last and (not names or pays.mean() > gate * _standard_error(pays)):
            return last
    return names


def _standard_error(values: Array) -> Array:
    return values.std(axis=0, ddof=1) / np.sqrt(FOLDS)


def shrunk(
    gram: Array,
    right: Array,
    square: float,
    rows: int,
    count: int,
    widths: Sequence[int],
    rounds: int = _ROUNDS,
) -> tuple[Array, Array, float, Array]:
    """Compute estimate, covariance, noise and precisions, with each term's size by evidence."""
    group = np.repeat(np.arange(len(widths)), widths)
    scale = np.r_[np.ones(count), np.sqrt(np.maximum(np.diag(gram)[count:], 1e-300))]
    gram, right = gram / np.outer(scale, scale), right / scale
    precision = np.r_[np.zeros(count), np.full(len(group), 1e-3)]
    while True:
        inverse = np.linalg.inv(gram + np.diag(precision) + _LEAST * np.diag(np.diag(gram)))
        value = inverse @ right
        known = 1.0 - precision * np.diag(inverse)
        left = square - 2.0 * float(value @ right) + float(value @ gram @ value)
        noise = left / max(rows - known.sum(), 1.0)
        rounds -= 1
        if not rounds or not len(widths):
            break
        energy = np.maximum(np.bincount(group, value[count:] ** 2), 1e-30)
        precision[count:] = np.clip(noise * np.bincount(group, known[count:]) / energy, 1e-9, 1e9)[group]
    return value / scale, inverse * noise / np.outer(scale, scale), noise, precision * scale**2
