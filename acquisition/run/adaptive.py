"""The poses that an adaptive block adds while it is measured, and when it ends.

    visits measured -> data set -> diagnosis -> bound of the error over the zone -> next batch, or the end

A look at the readings is a function of the record alone, so a campaign that was interrupted continues with the same
poses. It is made beside the measurement: it begins with the last visit of a batch, which the robot drives meanwhile. A
batch is checked like a whole plan before it joins the record. Everything that a look finds is an event `accuracy`.

The block ends when `LEAST` poses are measured, the upper limit of the RMS error over the zone is below the wanted one,
and the diagnosis does not find more noise than declared; or when its time is up, or its poses are. Near the floor the
limit still falls when the model is long known, because more misses tell more of the error. So ten more poses that would
gain the model less than 1 % end the block only if all poses that may follow would not bring the limit below the wanted
accuracy, even were the error as small as the misses allow; and not in a look whose poses missed by more than those
before, because something has happened that the next poses may explain.

The limit rests on the visits that a model with the same effects as now predicted; until there are any, on the last
ones. If a pattern remains that no cause explains, the readings chosen for the fit do not show it as readings anywhere
in the zone would: then only poses that were drawn at random count. Lengths mm, times s.

With a ballbar the stances are those of the cups as touched. From the second batch on, the robot is driven to them
through the model so far, and their legs are then within the stroke of the bar. A leg of the first poses that was
not is skipped: a leg of a later pose tells as much. The misses of legs do not show how wrong this model is where no
leg reaches. So every limit begins with the largest error that the covariance allows one model, at its own level.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from acquisition.campaign.blocks.adaptive import (
    BATCH,
    DRAWN,
    LEAST,
    AdaptiveBlock,
    Pool,
    first_of,
    in_order,
    numbers_in,
    pool_of,
    readings_in,
    seconds_to,
    seen_by,
    visits_of,
)
from acquisition.campaign.blocks.block import Site
from acquisition.campaign.campaign import Campaign, campaign_of_record
from acquisition.campaign.plan import READING_S, SAMPLES_PER_S, Visit, check_plan, site_of, visit_of
from acquisition.cell.cell import cell_of_record, with_nests
from acquisition.errors import RecordError, as_config_error
from acquisition.record.export import table_of
from acquisition.record.readings import readings_of
from acquisition.record.states import State
from acquisition.record.store import RecordStore
from acquisition.record.touches import taught_of
from acquisition.run.ballbar.driven_stances import driven, last_of
from acquisition.run.clock import Clock
from acquisition.run.duration import Begin
from acquisition.run.orders.control import Control
from calib.array import Array
from calib.data import Dataset
from calib.errors import DataError
from calib.fit import IdentificationFit
from calib.selection import (
    DECIDING,
    LEVEL,
    Design,
    WorkingZone,
    bound,
    declared_covariance,
    expected_rms,
    misses,
    model_limit,
)
from drivers.errors import AcquisitionError, OutOfRange

if TYPE_CHECKING:
    from calib.diagnose import DiagnosisFit

_LOOK_BACK = 15  # visits on which a bound rests while the model as it is now has predicted none
MORE, WORTH = 10, 0.01  # so many more poses must lower the expected error by this share
SETTLED = 30  # poses after which the noise that was found is believed
MOUNTING_S = 30.0  # for a person to put the bar between two balls
_LOOK_EVERY_S = 0.02  # on the wall, at a computation
_UNEXPLAINED = "unexplained"
_NOISY = "excess_noise"


@dataclass(frozen=True)
class Miss:
    """By how much a visit missed its prediction: as in `calib.selection.Misses`; `effects` were in the model."""

    visit: int
    square: float
    numbers: int
    drawn: bool
    effects: tuple[str, ...]


@dataclass(frozen=True)
class Accuracy:
    """What the readings so far promise.

    Attributes
    ----------
    poses
        Number of poses measured.
    minutes
        Time since the campaign began, to which the figures refer; without pauses.
    rms_mm, bound_mm
        RMS error of a reading in the zone, and its upper limit (95 %); None before a visit was predicted.
    deciding_mm
        Its upper limit with 95 % confidence in all looks together, which ends the block.
    floor_mm
        RMS of noise and repeatability, which no calibration lowers; None before the first diagnosis, as `rms_mm`.
    verdict
        That of the interim diagnosis; empty before the first.
    reached
        Whether the wanted accuracy is reached.
    ended
        Why no further poses follow; empty if they do.
    poses_left, minutes_left
        Expected until the accuracy is reached; None if it is not expected.
    misses
        Visits that were predicted in this look.
    """

    wanted_mm: float
    poses: int
    minutes: float
    rms_mm: float | None = None
    bound_mm: float | None = None
    deciding_mm: float | None = None
    floor_mm: float | None = None
    verdict: str = ""
    reached: bool = False
    ended: str = ""
    poses_left: int | None = None
    minutes_left: float | None = None
    misses: tuple[Miss, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return the values for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Sight:
    """What a look at the readings has to go by.

    Attributes
    ----------
    dataset
        All readings so far.
    visit : array of int, shape (n,)
        Number of the visit of each reading; -1 if it does not belong to the block.
    added, drawn
        Visits that were added in batches, and those of them that were drawn at random.
    judged
        Visits that earlier looks have predicted.
    taken
        Joints of the candidates that are planned, deg.
    here_deg
        Joints of the last planned pose.
    """

    block: AdaptiveBlock
    site: Site
    settle_s: float
    samples: int
    dataset: Dataset
    visit: NDArray[np.int64]
    added: frozenset[int]
    drawn: frozenset[int]
    judged: tuple[Miss, ...]
    taken: frozenset[tuple[float, ...]]
    here_deg: Array
    elapsed_s: float

    @property
    def rest_s(self) -> float:
        """Time that the robot rests in a pose, s."""
        return rest_s(self.site, self.settle_s, self.samples)

    @property
    def numbers(self) -> int:
        """Numbers that are measured in a pose."""
        return numbers_in(self.site)


@dataclass(frozen=True)
class Look:
    """The result of a look: the accuracy, and the candidates to measure next, in order; some of them drawn.

    `final` is the model of the interim diagnosis; None without one.
    """

    accuracy: Accuracy
    chosen: tuple[int, ...] = ()
    drawn: frozenset[int] = frozenset()
    final: IdentificationFit | None = None


def look(sight: Sight, pool: Pool) -> Look:
    """Judge the readings of an adaptive block, and choose what is measured next."""
    block, poses = sight.block, len(np.unique(sight.visit[sight.visit >= 0]))
    try:
        now, fresh = _diagnosed(sight)
    except DataError:  # too few readings as yet
        return _unjudged(sight, pool, poses)
    final = now.final
    rows, zone, expected_mm = _seen(sight, pool, final)
    design = Design(rows, zone.spread, declared_covariance(final))
    evidence = MissesThatCount.of(
        [*sight.judged, *fresh], _effects_of(final), sight.numbers, drawn_only=now.verdict == _UNEXPLAINED
    )
    rms_mm = bound_mm = deciding_mm = None
    if evidence.freedom:
        rms_mm, _ = evidence.limits_mm(expected_mm, LEVEL)
        bound_mm, deciding_mm = (
            evidence.limits_mm(float(np.hypot(expected_mm, _margin_mm(pool, design, level))), level)[1]
            for level in (LEVEL, DECIDING)
        )
    judged = Accuracy(
        wanted_mm=block.accuracy_mm,
        poses=poses,
        minutes=round(sight.elapsed_s / 60.0, 2),
        rms_mm=rms_mm,
        bound_mm=bound_mm,
        deciding_mm=deciding_mm,
        floor_mm=zone.floor_mm * max(final.noise_scale, 1.0),
        verdict=now.verdict,
        reached=(
            deciding_mm is not None
            and poses >= LEAST
            and deciding_mm <= block.accuracy_mm
            and now.verdict != _NOISY
        ),
        misses=tuple(fresh),
    )
    known_mm = 0.0
    if poses >= SETTLED and now.causes_known:
        freedom = final.degrees_of_freedom
        _, known_mm = bound(
            zone.floor_mm, np.array([final.noise_scale**2 * freedom]), np.array([freedom]), 1.0 - DECIDING
        )
    news = exceed(fresh, sight.judged)
    found = _next(sight, pool, judged, design, evidence, zone.floor_mm, known_mm, news=news)
    return replace(found, final=final)


def _margin_mm(pool: Pool, design: Design, level: float) -> float:
    """Return the error of one model beyond the expected one, at a level, mm; 0 if points are measured."""
    if not pool.legs:
        return 0.0
    return float(np.sqrt(model_limit(design.spread, design.covariance, level) - design.variance))


def _unjudged(sight: Sight, pool: Pool, poses: int) -> Look:
    """Choose the next batch while the readings do not determine a model."""
    _, design, floor_mm = first_of(sight.site, pool)
    judged = Accuracy(sight.block.accuracy_mm, poses, round(sight.elapsed_s / 60.0, 2))
    evidence = MissesThatCount.of([], (), sight.numbers)
    return _next(sight, pool, judged, design, evidence, floor_mm, 0.0, news=False)


def exceed(fresh: Sequence[Miss], earlier: Sequence[Miss]) -> bool:
    """Whether visits missed by more than earlier ones, beyond chance: something has happened meanwhile."""
    if not fresh or not earlier:
        return False
    least, most = (
        bound(
            1.0, np.array([miss.square for miss in each]), np.array([miss.numbers for miss in each]), level
        )[1]
        for each, level in ((fresh, 1.0 - DECIDING), (earlier, DECIDING))
    )
    return least > most


def _effects_of(found: IdentificationFit) -> tuple[str, ...]:
    """Return the labels of the effects in a model, by which misses of the same model are known."""
    return tuple(sorted(effect.label for effect in found.model.effects))


@dataclass(frozen=True)
class MissesThatCount:
    """The misses that tell how accurate the model is as it is now.

    Attributes
    ----------
    square : array of shape (v,)
        Squared standardised distances.
    numbers : array of int, shape (v,)
        Their degrees of freedom.
    per_pose : float
        Numbers that a further pose adds to those.
    """

    square: Array
    numbers: NDArray[np.int64]
    per_pose: float

    @staticmethod
    def of(
        judged: Sequence[Miss], effects: tuple[str, ...], numbers: int, *, drawn_only: bool = False
    ) -> MissesThatCount:
        """Choose the misses that count for a model with these effects, in poses with so many measured numbers."""
        seen = [miss for miss in judged if miss.drawn or not drawn_only]
        seen = [miss for miss in seen if miss.effects == effects] or seen[-_LOOK_BACK:]
        return MissesThatCount(
            np.array([miss.square for miss in seen]),
            np.array([miss.numbers for miss in seen], dtype=np.int64),
            numbers * (DRAWN / BATCH if drawn_only else 1.0),
        )

    @property
    def freedom(self) -> int:
        """Degrees of freedom of all misses."""
        return int(self.numbers.sum())

    def limits_mm(self, expected_mm: float, level: float) -> tuple[float, float]:
        """Return the RMS error over the zone and its upper limit at a level."""
        return bound(expected_mm, self.square, self.numbers, level)

    def later_mm(self, expected_mm: float, poses: int, *, hopeful: bool = False) -> float:
        """Return the limit that decides after more poses, if their misses are like those so far.

        With `hopeful`, they are as small as those so far allow.
        """
        seen, freedom = float(self.square.sum()), self.freedom
        scale = 1.0
        if freedom:
            scale = seen / float(chdtri(freedom, 1.0 - DECIDING)) if hopeful else max(seen / freedom, 1.0)
        numbers = freedom + max(round(poses * self.per_pose), 1)
        return bound(expected_mm, np.array([scale * numbers]), np.array([numbers]), DECIDING)[1]


def _next(
    sight: Sight,
    pool: Pool,
    judged: Accuracy,
    design: Design,
    evidence: MissesThatCount,
    floor_mm: float,
    known_mm: float,
    *,
    news: bool,
) -> Look:
    """End the block, or choose its next batch.

    `floor_mm` is the RMS of noise and repeatability in one reading as declared, `known_mm` what it
    is at least, as far as that is known. After `news` the next poses may tell their cause.
    """
    block = sight.block

    def expected_mm(design: Design) -> float:
        return float(np.hypot(np.sqrt(design.variance), floor_mm))

    def at_most_mm(design: Design) -> float:
        return float(np.hypot(expected_mm(design), _margin_mm(pool, design, DECIDING)))

    taken = [i for i, pose in enumerate(pool.candidates) if pose.joints_deg in sight.taken]
    pose_s = float(np.median(seconds_to(sight.site.cell, pool, sight.here_deg))) + sight.rest_s
    may_follow = max(block.most - len(sight.taken), 0)
    if block.minutes is not None:
        may_follow = min(may_follow, max(int((60.0 * block.minutes - sight.elapsed_s) / pose_s), 0))
    ended = _ending(sight, judged, pose_s, known_mm)
    if not ended and not news and judged.bound_mm is not None and judged.poses >= LEAST:
        later = design.best(MORE, taken)[1]
        best_mm = evidence.later_mm(at_most_mm(later), may_follow, hopeful=True)
        if expected_mm(later) > (1.0 - WORTH) * expected_mm(design) and best_mm > block.accuracy_mm:
            ended = (
                f"{block.accuracy_mm:g} mm cannot be reached: {MORE} more poses would lower the expected error by less "
                f"than {WORTH:.0%}, and {may_follow} would at best show {best_mm:.3f} mm. Noise and repeatability "
                f"alone are {judged.floor_mm:.3f} mm in every reading."
            )
    if not ended and pool.drawn - sum(i < pool.drawn for i in taken) < BATCH:
        ended = "No further poses are left: table, boxes and joint limits leave few in this cell."
    if ended:
        return Look(replace(judged, ended=ended, poses_left=0, minutes_left=0.0))
    left, used, later = None, list(taken), design
    for count in range(BATCH, may_follow + 1, BATCH):
        more, later = later.best(BATCH, used)
        used += more
        enough = judged.poses + count >= LEAST
        if enough and evidence.later_mm(at_most_mm(later), count) <= block.accuracy_mm:
            left = count
            break
    chosen, drawn = _batch(sight, pool, design, taken)
    minutes = None if left is None else round(left * pose_s / 60.0, 1)
    return Look(replace(judged, poses_left=left, minutes_left=minutes), chosen, drawn)


def _diagnosed(sight: Sight) -> tuple[DiagnosisFit, list[Miss]]:
    """Diagnose all readings, and predict the visits that no look has predicted from those before them."""
    from calib.diagnose import diagnose  # not at the start of a service, whose workers alone compute it

    dataset, known = sight.dataset, {miss.visit for miss in sight.judged}
    new = sorted(sight.added - known)
    held_out = np.isin(sight.visit, new) & dataset.usable
    now = diagnose(dataset)
    if not held_out.any():
        return now, []
    earlier = replace(dataset, sets=np.where(held_out, "validation", dataset.sets))
    before = diagnose(earlier)
    rows = held_out & ~before.held_out_faults.rows
    if not rows.any():
        return now, []
    found = misses(before.final, earlier, rows)
    visit_of_reading = dict(zip(dataset.reading_id, sight.visit.tolist(), strict=True))
    effects = _effects_of(before.final)
    return now, [
        Miss(visit, float(square), int(numbers), visit in sight.drawn, effects)
        for visit, square, numbers in zip(
            (visit_of_reading[reading] for reading in found.reading), found.square, found.numbers, strict=True
        )
    ]


def _seen(sight: Sight, pool: Pool, found: IdentificationFit) -> tuple[Array, WorkingZone, float]:
    """Return candidates and zone as a fitted model sees them after everything that was measured, and the error, mm."""
    stated = last_of(found)
    rows, zone = seen_by(sight.site, pool, found.model, found.estimate, stated, found.header.noise)
    poses = visits_of(sight.site, pool.zone, found.model, stated)
    return rows, zone, expected_rms(found, zone, poses)


def rest_s(site: Site, settle_s: float, samples: int) -> float:
    """Return the time that the robot rests in a pose, s.

    A person puts a ballbar on each leg, and takes it off.
    """
    many = readings_in(site)
    mountings = many + 1 if site.cell.instrument.declared.measures_lengths else 0
    return settle_s + many * (READING_S + samples / SAMPLES_PER_S) + mountings * MOUNTING_S


def _ending(sight: Sight, judged: Accuracy, pose_s: float, known_mm: float) -> str:
    """Return why the block ends, or an empty text; `known_mm` as in `_next`."""
    block = sight.block
    if judged.reached:
        return (
            f"The accuracy is reached: the RMS error is below {judged.bound_mm:.3f} mm with 95 % confidence; "
            f"required: {block.accuracy_mm:g} mm."
        )
    if block.minutes is not None and sight.elapsed_s + BATCH * pose_s > 60.0 * block.minutes:
        return f"The time is up: {block.minutes:g} minutes were given."
    if len(sight.taken) + BATCH > block.most:
        return f"The largest number of poses is reached: {block.most}."
    if judged.floor_mm is not None and known_mm > block.accuracy_mm:
        return (
            f"{block.accuracy_mm:g} mm cannot be reached: noise and repeatability alone are {judged.floor_mm:.3f} mm "
            "in every reading."
        )
    return ""


def _batch(
    sight: Sight, pool: Pool, design: Design, taken: Sequence[int]
) -> tuple[tuple[int, ...], frozenset[int]]:
    """Choose the next batch: most of it by gain per second, the rest drawn in the zone."""
    cell, used, here = sight.site.cell, list(taken), sight.here_deg
    among = np.arange(len(pool.candidates)) < pool.drawn
    drawn = [i for i in range(pool.drawn, len(pool.candidates)) if i not in used][:DRAWN]
    chosen: list[int] = []
    for _ in range(BATCH - len(drawn)):
        worth = np.where(among, design.gains, -np.inf) / (seconds_to(cell, pool, here) + sight.rest_s)
        worth[[*used, *chosen]] = -np.inf
        chosen.append(int(np.argmax(worth)))
        design, here = design.with_pose(chosen[-1]), pool.joints([chosen[-1]])[0]
    order = in_order(cell, pool, [*chosen, *drawn], sight.here_deg)
    return tuple(order), frozenset(drawn)


_BATCHES, _LOOKS = "batch", "accuracy"
# A program that is killed notes its pause when it is opened again, without a time.
_STATES = """
SELECT data, coalesce(t_s, (SELECT max(t_s) FROM event AS earlier WHERE earlier.id < event.id), 0) AS t_s
FROM event WHERE kind = 'state' ORDER BY id
"""
_OUT_OF_STROKE = """
SELECT id FROM pose WHERE status = 'deferred' AND replaced_by IS NULL AND base_target IS NOT NULL AND ? = (
    SELECT error_code FROM attempt WHERE attempt.pose = pose.id AND attempt.status = 'failed' ORDER BY id DESC LIMIT 1
)
"""
Found = tuple[Accuracy, tuple[Visit, ...], tuple[int, ...]]


def look_at(record_dir: Path) -> Found:
    """Look at the readings of a record, which another program may be writing.

    Returns the accuracy, the visits to add, checked, and the numbers of those that were drawn.

    Raises
    ------
    RecordError
        There is no record, or no reading in it.
    StorageError
        The record cannot be read.
    ConfigError, UnsafePlan
        The next poses cannot be planned, or may not be driven.
    """
    with RecordStore.reading(record_dir) as store:
        row, where = store.campaign, str(store.database.path)
        plan = list(dict.fromkeys(planned.visit for planned in store.plan()))
        batches, looks = store.data_of_events(_BATCHES), store.data_of_events(_LOOKS)
        of_reading = {str(reading.id): reading.visit for reading in readings_of(store)}
        elapsed_s = _measuring_s(store, looks)
        cell, campaign = cell_of_record(row["cell"], where), campaign_of_record(row["campaign"], where)
        taught = taught_of(store, cell)
    if taught is not None:
        cell = with_nests(cell, taught.nests_mm)
    found_block = block_of(campaign)
    if found_block is None:
        raise RecordError(f"{record_dir}: its campaign has no adaptive block")
    number, block = found_block
    site = site_of(cell, campaign, number)
    pool = pool_of(block, site)
    own = [visit for visit in plan if visit.block == number and visit.set == block.set]
    with as_config_error():
        dataset = table_of(record_dir).dataset()
    visit = np.array([of_reading.get(reading, -1) for reading in dataset.reading_id])
    sight = Sight(
        block=block,
        site=site,
        settle_s=campaign.settle_of(number).seconds,
        samples=campaign.samples,
        dataset=dataset,
        visit=np.where(np.isin(visit, [each.number for each in own]) & dataset.usable, visit, -1),
        added=frozenset(each for batch in batches for each in batch["visits"]),
        drawn=frozenset(each for batch in batches for each in batch["drawn"]),
        judged=tuple(
            Miss(**miss | {"effects": tuple(miss["effects"])}) for each in looks for miss in each["misses"]
        ),
        taken=frozenset(pool.goal(each.joints_deg, each.readings) for each in own),
        here_deg=np.array(plan[-1].joints_deg),
        elapsed_s=elapsed_s,
    )
    found = look(sight, pool)
    first, last = len(own) + 1, plan[-1]
    added = [
        replace(visit_of(block, site, pool.visit(site, i, first + k)), number=last.number + 1 + k)
        for k, i in enumerate(found.chosen)
    ]
    if pool.legs and found.final is not None:
        added = driven(cell, found.final, added)
    drawn = tuple(visit.number for visit, i in zip(added, found.chosen, strict=True) if i in found.drawn)
    visits = _with_reference(campaign, plan, added)
    check_plan(cell, [last, *visits])
    return found.accuracy, tuple(visits), drawn


def _measuring_s(store: RecordStore, looks: Sequence[Mapping[str, Any]]) -> float:
    """Return the campaign time since the beginning, s, without pauses.

    A simulated robot, whose clock is faster than the computer, does not wait for a look either.
    """
    (now_s,) = store.database.query("SELECT coalesce(max(t_s), 0) FROM event")[0]
    rested_s, since_s = 0.0, None
    for row in store.database.query(_STATES):
        if State(json.loads(row["data"])["state"]).active:
            rested_s += 0.0 if since_s is None else row["t_s"] - since_s
            since_s = None
        elif since_s is None:
            since_s = row["t_s"]
    waited_s = sum(each["waited_s"] for each in looks) if store.campaign["simulated"] else 0.0
    return now_s - rested_s - waited_s


def block_of(campaign: Campaign) -> tuple[int, AdaptiveBlock] | None:
    """Return number and table of the adaptive block of a campaign, or None without one."""
    return next(
        ((i, each) for i, each in enumerate(campaign.blocks) if isinstance(each, AdaptiveBlock)), None
    )


def _with_reference(campaign: Campaign, plan: Sequence[Visit], added: Sequence[Visit]) -> list[Visit]:
    """Append the reference pose to a batch where it is due."""
    places = [i for i, visit in enumerate(plan) if visit.set == "reference"]
    if not added or not places or not campaign.reference_every:
        return list(added)
    since = sum(len(visit.targets) for visit in (*plan[places[-1] + 1 :], *added))
    if since < campaign.reference_every:
        return list(added)
    return [*added, replace(plan[places[0]], number=added[-1].number + 1, block=added[-1].block)]


class AdaptiveSelection:
    """The adaptive block of a run: it adds poses to the record until the block ends.

    `begin` starts a look in the background.
    """

    def __init__(
        self, store: RecordStore, campaign: Campaign, begin: Begin, control: Control, clock: Clock
    ) -> None:
        self._store, self._begin, self._control, self._clock = store, begin, control, clock
        looks = store.data_of_events(_LOOKS)
        self._over = block_of(campaign) is None or bool(looks and looks[-1]["ended"])
        self._look: Future[Found] | None = None
        self._waited_s = 0.0  # by the robot, for a look

    def _begin_look(self) -> Future[Found]:
        begun_s = self._clock.now()
        self._look = self._begin(look_at, self._store.database.path.parent)
        self._waited_s += self._clock.now() - begun_s
        return self._look

    def look_ahead(self) -> None:
        """Begin a look while the robot drives the last visit that is planned."""
        if self._over or self._look is not None or not self._store.counts().get("measured"):
            return
        planned = [reading for reading in self._store.plan() if reading.status == "planned"]
        by_person = any(reading.base_target is not None for reading in planned)  # who takes long for a visit
        if len({reading.visit.number for reading in planned}) == 1 and not by_person:
            self._begin_look()

    def extend(self) -> bool:
        """Add the next batch to the plan once everything planned is measured; return whether there is one.

        Raises
        ------
        Pausing, Stopping
            The run must pause or stop.
        ConfigError, UnsafePlan
            The next poses may not be driven.
        StorageError
            The record cannot be read or written.
        """
        if self._over or not self._store.counts().get("measured"):
            return False
        look = self._look or self._begin_look()
        begun_s = self._clock.now()
        while not look.done():
            self._control.check()
            self._control.wait(_LOOK_EVERY_S * self._clock.time_scale)
        self._waited_s += self._clock.now() - begun_s
        self._look = None
        error = look.exception()
        other = error is not None and not isinstance(error, AcquisitionError)  # no process was free for it
        accuracy, visits, drawn = look_at(self._store.database.path.parent) if other else look.result()
        waited_s, self._waited_s = self._waited_s, 0.0
        with self._store.changing() as db:
            for (pose,) in db.execute(_OUT_OF_STROKE, (OutOfRange.code,)).fetchall():
                self._store.mark(pose, "skipped", "out of the stroke of the bar; later poses take its place")
            self._store.note(db, _LOOKS, **accuracy.as_dict(), waited_s=waited_s)
            if visits:
                self._store.add_visits(visits)
                own = [visit.number for visit in visits if visit.set != "reference"]
                self._store.note(db, _BATCHES, visits=own, drawn=list(drawn))
        self._over = bool(accuracy.ended)
        return bool(visits)
