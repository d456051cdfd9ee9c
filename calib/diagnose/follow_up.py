"""Poses that would distinguish rival explanations: what to measure next when a diagnosis is ambiguous.

Each rival b of an effect a is fitted in its place. Where the two models predict d(x) apart at a pose x, and the
rival's parameters with covariance C may still adapt themselves (columns J), a reading with noise S separates them by

    d' (S + J C J')^-1 d,

the squared Mahalanobis distance. Poses are taken one by one, each where it separates most what is separated least
so far; after each the rival is fitted to what would be seen there (a Kalman step on d and C), so that the next pose
looks elsewhere. Source: Atkinson & Fedorov 1975 (T-optimal designs, sequential form).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.header import Header
from calib.effects import kind_of
from calib.effects.kind import SECOND_TARGET, distinguishing
from calib.fit.identification import Identification
from calib.model.model import Design
from calib.model.stated import StatedConditions, conditions_at
from calib.units import DEG

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
Rivals = Mapping[Pair, Identification]
"""The model refitted with each rival."""


@dataclass(frozen=True)
class FollowUp:
    """The poses to measure next: joints (n, N) rad as the controller counts them, sides (n,) +1 from below or -1 from
    above on every joint, approach (n,) rad, the length of the last move, targets (n,) by name; and what it would bring.

    separations: squared distances in units of the noise, once all poses are measured.
    procedures: what no pose can do. rivals: what is to be distinguished, to choose among other poses.
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
        """Whether measuring the poses would bring at least one pair a good step apart."""
        return max(self.separations.values()) >= HELPS


def later_visits(
    found: Identification, joints: Array, sides: Array, approach: Array, targets: Sequence[str]
) -> Conditions:
    """Conditions of visits at joints (n, N) rad as the controller counts them, after everything that was measured.

    sides (n,) +1 or -1 on every joint, approach (n,) rad: length of the last move; targets (n,) names of targets of
    the last series. Temperature and time are those of the last reading. Raises ValueError for an unknown target.
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
    previous = robot.model_angles(joints - (sides * approach)[:, None] * robot.steps, coupling)
    parts = {name: conditions_at(found.model, turned, stated, name) for name in dict.fromkeys(targets)}
    made = next(iter(parts.values()))
    points = np.stack([part.point for part in parts.values()])
    which = np.array([list(parts).index(name) for name in targets])
    return replace(
        made,
        side=np.where(turned >= previous, 1.0, -1.0),
        previous=previous,
        point=points[which, np.arange(len(which))],
        target=np.array([made.target_names.index(name) for name in targets]),
    )


def candidates(found: Identification) -> Conditions:
    """Visits drawn evenly within the limits of the robot: either side of approach, a short or a long last move, any
    target of the last series."""
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
    found: Identification, rivals: Rivals, among: Conditions, count: int = POSES
) -> tuple[list[int], Array]:
    """Indices of `count` of the candidate conditions, and the separation (rivals,) that they bring."""
    noise = _noise(found, among)
    here = found.predict(among)
    apart, columns, spread = [], [], []
    for fitted in rivals.values():
        design = Design(fitted.model, among)
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


def follow_up(found: Identification, rivals: Rivals) -> FollowUp:
    """The poses that separate all `rivals` best, within the limits of the robot."""
    return separating(found, rivals, candidates(found))


def separating(found: Identification, rivals: Rivals, among: Conditions) -> FollowUp:
    """The follow-up chosen among given visits: those that a cell can take, for instance."""
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


def _procedures(alike: Sequence[Pair], found: Identification) -> tuple[str, ...]:
    """Procedures that would separate the pairs that no pose separates, a sentence for each kind of advice."""
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


def _advice(label: str, rival: str, found: Identification) -> list[str]:
    procedures = distinguishing(kind_of(label), kind_of(rival))
    if len(set(found.readings.conditions.target.tolist())) > 1:
        procedures = [each for each in procedures if each != SECOND_TARGET]
    return procedures or ["no pose within the limits does; they are one effect for every use of the model."]


def _noise(found: Identification, conditions: Conditions) -> Array:
    """(n, 3, 3) covariance of a reading at every candidate, for the noise that was found, mm2."""
    header: Header = found.header
    joints = found.model.robot.joint_slots
    frames = Design(found.model, conditions).frames(found.estimate, joints)
    points = np.broadcast_to(frames.p, (3, len(conditions))).T
    typical = found.readings.observed.alone.whiten
    if header.noise.kind == "per-row":
        # what the readings had on average
        variance = 1.0 / np.mean(np.sum(typical**2, axis=1)[: min(3, len(typical))])
        covariance = np.broadcast_to(np.eye(3) * variance, (len(points), 3, 3))
    else:
        covariance = header.noise.of_points(points, np.full(points.shape, np.nan))
        covariance = covariance + header.noise.of_joints(frames.velocities(joints), found.model.robot.kinds)
    return covariance * max(found.noise_scale, 1.0) ** 2


def _last(values: Array, order: Array) -> float:
    value = float(values[np.argmax(order)])
    return value if np.isfinite(value) else 0.0
