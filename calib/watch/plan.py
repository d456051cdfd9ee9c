"""The plan of a watch: which visits to make from which sides, how much to read in each, and what they will show."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.data.header import Header
from calib.errors import DataError
from calib.saved import SavedModel
from calib.units import DEG
from calib.watch.choose import choose
from calib.watch.judge import RATE
from calib.watch.lack import scatter_beyond
from calib.watch.planned import planned
from calib.watch.rounds import Rounds, fewest
from calib.watch.seen import Seen
from calib.watch.sizes import Shown, shown
from calib.watch.visits import Visits

FEWEST = 4


@dataclass(frozen=True)
class Plan:
    """The chosen of some candidates, by index; the visits, each chosen one as often as asked; what they show; rounds:
    how often each is visited, repeats: how often everything is read in a visit."""

    chosen: tuple[int, ...]
    visits: Visits
    shown: Shown
    rounds: int = 1
    repeats: int = 1


def plan(
    saved: SavedModel,
    header: Header,
    candidates: Visits,
    count: int,
    rate: float = RATE,
    *,
    times: int | None = 1,
    repeats: int | None = 1,
    frame_known: bool = True,
) -> Plan:
    """Choose `count` of the candidates, visit each so many times, every other time from the opposite sides, and read
    everything so many times in each visit.

    header: what the readings would be taken with; every candidate has as many readings as any other. times, repeats
    None: as few as show every cause from the size that it should be seen at, or what comes near the best where none
    does. frame_known False: where the instrument or the artefact stands will not be compared.
    Raises DataError for fewer visits than can tell anything, or more than there are candidates.
    """
    if not FEWEST <= count <= len(candidates):
        raise DataError(f"is {count}.", do=f"Give {FEWEST} to {len(candidates)} poses.", key="--poses")
    both = times is None or times > 1
    offered = candidates.again(2 if both else 1)
    would = planned(saved, header, offered)
    lack = scatter_beyond(saved, would)
    # what the model lacks is drawn anew with each pose, as the repeatability is with each visit
    noise = header.noise
    rougher = replace(
        noise,
        repeatability=float(np.hypot(noise.repeatability, lack)),
        repeatability_mm=float(np.hypot(noise.repeatability_mm, lack / DEG)),
    )
    would = replace(would, header=replace(header, noise=rougher))
    seen = Seen.of(saved, would, frame_known=frame_known, lack=0.0)
    chosen = choose(seen, seen.visit % len(candidates), count)
    once = candidates.take(chosen)
    tried = Rounds(times or 1, repeats or 1)
    if times is None or repeats is None:
        limit = judged(saved, header, once, rate, frame_known=frame_known, lack=lack).limit
        tried = fewest(
            saved, header, once, limit, times=times, repeats=repeats, frame_known=frame_known, lack=lack
        ).rounds
    visits = tried.of(once)
    found = judged(saved, header, visits, rate, frame_known=frame_known, lack=lack)
    return Plan(tuple(chosen), visits, found, tried.times, tried.repeats)


def judged(
    saved: SavedModel,
    header: Header,
    visits: Visits,
    rate: float = RATE,
    *,
    frame_known: bool = True,
    lack: float | None = None,
) -> Shown:
    """What some visits will show. lack: as `Seen.of`."""
    seen = Seen.of(saved, planned(saved, header, visits), frame_known=frame_known, lack=lack)
    return shown(seen, rate)
