"""The nests on the table, which locate the instrument in the world.

They are measured until they agree with the cell file. The frame of a record stays while its nests have not moved beyond
the noise (`cell.station`). Otherwise the instrument has a new station, and its readings go through a new frame from
then on. A ballbar has no station: the balls on the base are the world.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from acquisition.cell import world_frame
from acquisition.cell.cell import Cell, covariance_of, moved_by
from acquisition.cell.world_frame import WorldFrame
from acquisition.errors import NestsDisagree
from acquisition.record.store import PlannedReading, RecordStore
from calib.fit import judge_points


class Nests:
    """The nests of one execution.

    Attributes
    ----------
    world
        The world frame; None until the nests are measured, and for a ballbar.

    Parameters
    ----------
    try_at
        Makes one try at a nest.
    consult
        Asks a person about an error.
    """

    def __init__(
        self,
        store: RecordStore,
        cell: Cell,
        try_at: Callable[[PlannedReading], object],
        consult: Callable[[NestsDisagree], object],
    ) -> None:
        self._store = store
        self._cell = cell
        self._try_at = try_at
        self._consult = consult
        self.world: WorldFrame | None = None
        self._where_mm: Mapping[str, Sequence[float]] = {}

    def near_mm(self, planned: PlannedReading) -> Sequence[float] | None:
        """Return the point (3,), mm, tracker frame, to which the beam is sent for a nest.

        It is None if a person aims the beam or the tracker finds the nest by its name.
        """
        return self._where_mm.get(planned.target) if planned.visit.kind == "nest" else None

    def measure(self, reason: str, *, aim: bool = True) -> None:
        """Measure all nests, including those measured before.

        Three nests measured from two stations would make no frame. With `aim`, the beam is not sent to their last
        places, because the instrument may have been moved; a person aims a tracker that knows no names. Errors of a try
        and of the question to a person are passed on.
        """
        self.world = None
        if self._cell.instrument.declared.measures_lengths:
            return
        by_place = not (aim or self._cell.instrument.declared.finds_by_name)
        self._where_mm = self._store.nests_mm() if by_place else {}
        self._store.measure_nests_again(reason)
        while self.world is None:
            while left := self._store.left("planned", nests=True):
                self._try_at(left[0])
            try:
                self.world = self._settled_world()
            except NestsDisagree as error:
                self._where_mm = {}
                self._store.measure_nests_again(error.message)
                self._consult(error)

    def _settled_world(self) -> WorldFrame:
        """Return the frame of the record if the nests have not moved, otherwise a new one."""
        nests = self._store.nests_mm()
        found = world_frame.from_nests(nests, self._cell.nests, self._cell.nests_u_mm)
        kept = self._store.world
        if kept is not None:
            moved = moved_by(self._nests_of(kept), nests, self._cell.instrument.noise)
            if moved is None:
                return kept
            off_mm, ratio = moved
            self._store.add_event("instrument_moved", nests_off_mm=off_mm, ratio=ratio)
        self._store.set_world(found, nests, new_station=kept is not None)
        self._doubt(nests)
        return found

    def _doubt(self, nests: Mapping[str, Sequence[float]]) -> None:
        """Report each nest that is not where the cell file states.

        This needs the uncertainties of all nests in the cell file.
        """
        names = list(self._cell.nests)[:3]
        u_mm = [self._cell.nests_u_mm.get(name, 0.0) for name in names]
        if min(u_mm) <= 0.0:
            return
        seen = np.array([nests[name] for name in names], dtype=np.float64)
        stated = np.array([self._cell.nests[name] for name in names])
        noise = covariance_of(seen, self._cell.instrument.noise)
        for name, u, judged in zip(
            names, u_mm, judge_points(seen, stated, np.array(u_mm), noise, names), strict=True
        ):
            if judged.doubted:
                self._store.add_event("nest_doubted", nest=name, text=judged.in_words(f"Nest {name}", u))

    def _nests_of(self, world: WorldFrame) -> Mapping[str, Sequence[float]]:
        """Return the nests as they were measured.

        A record of version 1 has only their nominal places.
        """
        nominal = {
            name: tuple(world.to_tracker(self._cell.nests[name])) for name in list(self._cell.nests)[:3]
        }
        return self._store.world_nests_mm or nominal
