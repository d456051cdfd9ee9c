"""Recommended next measurements, and remarks on the current readings.

Poses are chosen to distinguish rival explanations. Each rival b of an effect a is fitted instead of a. At a pose x the
predictions of the two models differ by d(x), and the parameters of the rival, with covariance C and columns J, may
still adapt. A reading with noise S separates the two by the squared Mahalanobis distance d' (S + J C J')^-1 d. Poses
are taken one by one, each where it best separates the pair that is separated least so far. After each pose the rival is
fitted to the predicted reading (a Kalman step on d and C). Source: Atkinson & Fedorov 1975 (T-optimal designs,
sequential form).

If the cause is unknown, the recommendation follows from the places of structure. It varies that quantity alone, so that
the next diagnosis can distinguish it from quantities that varied together with it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtr, chdtrc

from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.data.header import Header
from calib.diagnose.found import COVERAGE
from calib.diagnose.structure import ACTS_ON, DISTANCE, EACH_POSE, OVERTURNING, QUICK, SIGHT, TIME, TOGETHER
from calib.effects import kind_of
from calib.effects.kind import SECOND_TARGET, distinguishing
from calib.fit.identification import IdentificationFit
from calib.model.base_model import COMPLIANCE
from calib.model.model import BoundModel, StatedConditions, conditions_of
from calib.units import DEG, to_display

_MOST = 5  # sentences
_AXIS = r"([^\s]+)"

_SWEEP = (
    "Move joint {} alone through its range in small steps, up and back down, with all other joints at rest; "
    "read at every step."
)
_PAIR = (
    "Move joint {0} alone through its range at three positions of joint {1}; then exchange the two joints."
)
_SIDES = (
    "Visit the first ten poses again, once with joint {} arriving from below and once from above, "
    "with the same last move otherwise."
)
_MOVES = "Visit the same poses after last moves of joint {} of several lengths, such as 2, 10 and 40 degrees."
_LOAD = "Measure some of the same poses with another payload, declared in the header."
_REPEAT = (
    "Repeat the first ten poses now, in the middle and at the end of the next campaign: what depends on time "
    "differs, what depends on the pose does not."
)
_STILL = "Read one pose thirty times without moving the robot: this shows the noise of the instrument alone."
_PAUSE = "Read the same pose at once, after 10 s and after 60 s at rest, at several poses."
_WARMTH = (
    "Measure the same poses at another air temperature, and record it for each reading (t_air_c); "
    "let it rise and fall, so that it does not follow the clock."
)
_STATION = "Measure some of the same poses again with the instrument at another place."
_TURN = "Measure the same places with the tool turned by 90 and by 180 degrees, and all tool targets at each pose."
_SINGLE = "Move each joint alone through its range, all others at rest: this shows which joint it belongs to."
_NEAR = "Measure more poses near those where the error is largest."
_AGAIN = "Measure the poses of the readings that were left out again: faulty readings do not repeat, an effect does."

_OF_JOINT = (
    (re.compile(rf"joint {_AXIS} and joint {_AXIS} angles"), _PAIR),
    (re.compile(rf"joint {_AXIS} angle"), _SWEEP),
    (re.compile(rf"side of approach of joint {_AXIS}.*"), _SIDES),
    (re.compile(rf"last move (?:but one )?of joint {_AXIS}"), _MOVES),
)
_OF_PLACE = (
    (("torque", "moment across", "last change of torque", OVERTURNING, "payload"), _LOAD),
    ((QUICK,), _STILL),
    (("time since the last move",), _PAUSE),
    ((TIME,), _REPEAT),
    (("temperature",), _WARMTH),
    (("tool target", "direction of the tool", "side of the tool"), _TURN),
    (("region of the workspace", "direction of view", DISTANCE, SIGHT), _STATION),
    ((EACH_POSE,), _NEAR),
    ((TOGETHER,), _SINGLE),
)


def next_measurements(places: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Recommend measurements as sentences, most informative first.

    Without a place of structure, the measurements separate noise from an unknown law.

    Parameters
    ----------
    places : iterable of (str, str)
        Driver and place of action of each error, as `ResidualStructure.where` and `ResidualStructure.acts_on`.
    """
    advice: list[str] = []
    for where, acts_on in places:
        if acts_on == ACTS_ON:
            advice.append(_AGAIN)
        advice.append(_of(where))
        # a joint whose error follows the load or the time is also examined alone
        if own := re.fullmatch(rf"joint {_AXIS}", acts_on):
            advice.append(_SWEEP.format(own[1]))
        if acts_on == SIGHT:
            advice.append(_STATION)
    told = list(dict.fromkeys(advice))[:_MOST]
    return tuple(told or (_REPEAT, _STILL))


def _of(where: str) -> str:
    for pattern, sentence in _OF_JOINT:
        if found := pattern.fullmatch(where):
            return sentence.format(*found.groups())
    return next(
        (sentence for begins, sentence in _OF_PLACE if where.startswith(begins)),
        _REPEAT,
    )


POSES = 12
_CANDIDATES = 1500
SEPARATES = 30.0
"""Squared distance that settles a pair: odds of exp(-15) against the wrong one when the noise is as found."""

HELPS = 9.0
"""Squared distance from which measuring is worth the time: three standard deviations."""

APPROACHES = (5.0 * DEG, 15.0 * DEG)
"""Lengths of the last move among which poses choose: what lags behind a move grows with it, play does not."""


Pair = tuple[str, str]
"""The label of an effect, and that of a rival: of another explanation in its place."""
Rivals = Mapping[Pair, IdentificationFit]
"""The model refitted with each rival."""


@dataclass(frozen=True)
class FollowUp:
    """Poses to measure next, and their expected effect.

    Attributes
    ----------
    joints : array of shape (n, N)
        Controller angles, rad.
    sides : array of shape (n,)
        Side of approach of every joint, +1 from below or -1 from above.
    approach : array of shape (n,)
        Length of the last move, rad.
    targets : tuple of str
        Name of the target of each pose.
    separations : dict
        Squared distance of each pair in units of the noise, after all poses are measured.
    procedures : tuple of str
        Procedures for pairs that no pose separates.
    rivals : mapping
        Refitted models of the pairs, for a choice among other poses.
    """

    joints: Array
    sides: Array
    approach: Array
    targets: tuple[str, ...]
    separations: dict[Pair, float]
    procedures: tuple[str, ...]
    rivals: Rivals

    @property
    def helps(self) -> bool:
        """Whether the poses would separate at least one pair by `HELPS` or more."""
        return max(self.separations.values()) >= HELPS


def later_visits(
    found: IdentificationFit, joints: Array, sides: Array, approach: Array, targets: Sequence[str]
) -> Conditions:
    """Build conditions of visits after everything that was measured.

    Temperature and time are those of the last reading.

    Parameters
    ----------
    joints : array of shape (n, N)
        Controller angles, rad.
    sides : array of shape (n,) or (n, N)
        Side of approach of every joint, or of each, +1 or -1.
    approach : array of shape (n,)
        Length of the last move, rad.
    targets : sequence of str
        Names of targets of the last series.

    Raises
    ------
    ValueError
        A target is unknown.
    """
    readings, robot, coupling = found.readings.conditions, found.model.robot, found.header.coupling
    stated = StatedConditions(
        temperature_c=_last(readings.temperature, readings.order),
        time_s=_last(readings.time, readings.order),
        loads=found.header.loads,
        gravity=found.header.gravity,
        series=readings.series_names[-1],
    )
    turned = robot.model_angles(joints, coupling)
    moved = np.reshape(sides, (len(joints), -1)) * approach[:, None]
    previous = robot.model_angles(joints - moved * robot.steps, coupling)
    return conditions_of(found.model, turned, previous, stated, targets)


def candidates(found: IdentificationFit) -> Conditions:
    """Draw visits evenly within the limits of the robot.

    Each has one side of approach, a short or a long last move, and a target of the last series.
    """
    robot = found.model.robot
    rng = np.random.default_rng(0)
    sides = rng.choice((-1.0, 1.0), _CANDIDATES)
    approach = rng.choice(APPROACHES, _CANDIDATES)
    reach = approach[:, None] * robot.steps
    reach = np.where(reach < np.subtract(robot.upper, robot.lower), reach, 0.0)  # rods hold a joint
    low = robot.lower + reach * (sides[:, None] > 0.0)
    high = robot.upper - reach * (sides[:, None] < 0.0)
    names = tuple(found.model.targets[found.readings.conditions.series_names[-1]])
    targets = [names[i] for i in rng.integers(0, len(names), _CANDIDATES)]
    return later_visits(found, rng.uniform(low, high), sides, approach, targets)


def choose(
    found: IdentificationFit, rivals: Rivals, among: Conditions, count: int = POSES
) -> tuple[list[int], Array]:
    """Choose `count` of the candidate conditions.

    Returns the indices of the chosen, and the separation (rivals,) that they achieve.
    """
    noise = _noise(found, among)
    here = found.predict(among)
    apart, columns, spread = [], [], []
    for fitted in rivals.values():
        design = BoundModel(fitted.model, among)
        frames = design.frames(fitted.estimate, design.slots)
        n = len(among)
        apart.append(here - np.broadcast_to(frames.p, (3, n)).T)
        columns.append(design.point_columns(frames).reshape(3, n, -1).transpose(1, 0, 2))
        spread.append(fitted.covariance.copy())
    total = np.zeros(len(rivals))
    chosen: list[int] = []
    for _ in range(min(count, len(among))):
        weights = [
            np.linalg.inv(noise + np.einsum("nam,nbm->nab", j @ c, j))
            for j, c in zip(columns, spread, strict=True)
        ]
        gains = np.array([np.einsum("na,nab,nb->n", d, w, d) for d, w in zip(apart, weights, strict=True)])
        worth = np.min(total[:, None] + gains, axis=0) + 1e-3 * gains.sum(axis=0)
        worth[chosen] = -np.inf
        best = int(np.argmax(worth))
        chosen.append(best)
        for r, (d, j, c, w) in enumerate(zip(apart, columns, spread, weights, strict=True)):
            total[r] += gains[r, best]
            gain = c @ j[best].T @ w[best]
            apart[r] = d - j @ (gain @ d[best])
            spread[r] = c - gain @ (j[best] @ c)
    return chosen, total


def follow_up(found: IdentificationFit, rivals: Rivals) -> FollowUp:
    """Choose the poses within the limits of the robot that separate all `rivals` best."""
    return separating(found, rivals, candidates(found))


def separating(found: IdentificationFit, rivals: Rivals, among: Conditions) -> FollowUp:
    """Choose the follow-up among given visits, for example those that a cell can reach."""
    chosen, total = choose(found, rivals, among)
    separations = dict(zip(rivals, map(float, total), strict=True))
    few = among.take(np.array(chosen))
    robot, coupling = found.model.robot, found.header.coupling
    joints = robot.controller_angles(few.joints, coupling)
    moves = joints - robot.controller_angles(few.previous, coupling)
    return FollowUp(
        joints=joints,
        sides=np.sign(moves[:, 0]),
        approach=np.max(np.abs(moves) / robot.steps, axis=1),
        targets=tuple(few.target_names[t] for t in few.target),
        separations=separations,
        procedures=_procedures([pair for pair, s in separations.items() if s < SEPARATES], found),
        rivals=rivals,
    )


def _procedures(alike: Sequence[Pair], found: IdentificationFit) -> tuple[str, ...]:
    """List procedures for the pairs that no pose separates, one per kind of advice."""
    pairs: dict[str, dict[str, list[str]]] = {}
    for label, rival in alike:
        for advice in _advice(label, rival, found):
            pairs.setdefault(advice, {}).setdefault(label, []).append(rival)
    return tuple(
        f"To distinguish {'; '.join(f'{label} from {_listed(others)}' for label, others in pair.items())}: {advice}"
        for advice, pair in pairs.items()
    )


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"


def _advice(label: str, rival: str, found: IdentificationFit) -> list[str]:
    procedures = distinguishing(kind_of(label), kind_of(rival))
    if len(set(found.readings.conditions.target.tolist())) > 1:
        procedures = [each for each in procedures if each != SECOND_TARGET]
    return procedures or ["no pose within the limits does; they are one effect for every use of the model."]


def _noise(found: IdentificationFit, conditions: Conditions) -> Array:
    """Compute the covariance (n, 3, 3) of a reading at every candidate, mm2.

    It uses the noise that was found.
    """
    header: Header = found.header
    joints = found.model.robot.joint_slots
    frames = BoundModel(found.model, conditions).frames(found.estimate, joints)
    points = np.broadcast_to(frames.p, (3, len(conditions))).T
    typical = found.readings.observed.alone.whiten
    if header.noise.kind == "per-row":
        # average of the readings
        variance = 1.0 / np.mean(np.sum(typical**2, axis=1)[: min(3, len(typical))])
        covariance = np.broadcast_to(np.eye(3) * variance, (len(points), 3, 3))
    else:
        covariance = header.noise.of_points(points, np.full(points.shape, np.nan))
        covariance = covariance + header.noise.of_joints(frames.velocities(joints), found.model.robot.kinds)
    return covariance * max(found.noise_scale, 1.0) ** 2


def _last(values: Array, order: Array) -> float:
    value = float(values[np.argmax(order)])
    return value if np.isfinite(value) else 0.0


_RARE = 0.001  # probability of a remark on the noise without reason
_LARGE = 0.75  # ratio of found noise to declared below which the declared one is too large
_FAR = 0.1  # below it the identification warns of wrong units
_SURE = 3.0  # standard errors below zero that make a compliance negative
_FEWEST = 10  # fewest repeats within visits that determine the noise of the instrument


def remarks_of(dataset: Dataset, fitted: IdentificationFit) -> tuple[str, ...]:
    """Remark on the noise of a fit and on its compliances."""
    return (*_declared(fitted), *_within_visits(dataset, fitted), *_negative(fitted))


def _declared(fitted: IdentificationFit) -> list[str]:
    scale, freedom = fitted.noise_scale, fitted.degrees_of_freedom
    if not _FAR < scale < _LARGE or chdtr(freedom, freedom * (scale / _LARGE) ** 2) > _RARE:
        return []
    return [
        f"The residuals are {scale:.2g} times the declared noise: [noise] in the header is too large. Uncertainties "
        "and the smallest detectable sizes count with the declared noise, so that they are too large as well."
    ]


def _within_visits(dataset: Dataset, fitted: IdentificationFit) -> list[str]:
    """Estimate the noise of the instrument alone, from repeated readings while the robot rested."""
    conditions, rows = fitted.readings.conditions, fitted.readings.rows
    rest = np.column_stack([conditions.visit, conditions.target, conditions.anchor, conditions.series])
    group = np.unique(rest, axis=0, return_inverse=True)[1].reshape(-1)
    noise = dataset.header.noise
    total, count, repeats = 0.0, 0, 0
    pointed, spanned = dataset.pointed[rows], dataset.spanned[rows]
    if pointed.any():
        points = dataset.points[rows][pointed]
        apart, spare = _apart(points, group[pointed])
        covariance = noise.of_points(points, dataset.u_point[rows][pointed])
        total += float(np.sum(apart * np.linalg.solve(covariance, apart[:, :, None])[:, :, 0]))
        count, repeats = count + 3 * spare, repeats + spare
    if spanned.any():
        apart, spare = _apart(dataset.lengths[rows][spanned, None], group[spanned])
        given = dataset.u_length[rows][spanned]
        total += float(np.sum((apart[:, 0] / np.where(np.isfinite(given), given, noise.length_mm)) ** 2))
        count, repeats = count + spare, repeats + spare
    if repeats < _FEWEST:
        return []
    ratio = math.sqrt(total / count)
    if chdtrc(count, total) < _RARE:
        means = "the instrument scatters more than declared"
    elif chdtr(count, total) < _RARE:
        means = "the instrument scatters less than declared"
    else:
        means = "as declared"
    return [
        f"{repeats} repeated readings within visits, during which the robot rested, scatter {ratio:.2g} times the "
        f"declared noise of the instrument: {means}. The repeatability of the robot does not show in them."
    ]


def _apart(values: Array, group: NDArray[np.int64]) -> tuple[Array, int]:
    """Subtract the mean of their group (n,) from values (n, c).

    Also returns the number of readings beyond one per group.
    """
    _, own, size = np.unique(group, return_inverse=True, return_counts=True)
    means = np.array([np.bincount(own, column) for column in values.T]).T / size[:, None]
    return values - means[own], len(values) - len(size)


def _negative(fitted: IdentificationFit) -> list[str]:
    """Report compliances of the base model that are negative beyond their uncertainty."""
    found = []
    for p, value, std in zip(fitted.model.parameters, fitted.estimate, fitted.standard_errors, strict=True):
        if p.unit == COMPLIANCE and "." not in p.name and value + _SURE * std < 0.0 < std:
            shown, u = (to_display(float(x), p.unit) for x in (value, COVERAGE * std))
            found.append(
                f"The compliance {p.name} came out negative ({shown:.2g} ± {u:.1g} {p.unit}), which no joint can be: "
                "another effect is imitated by it. Check the masses and centres of the loads."
            )
    return found
