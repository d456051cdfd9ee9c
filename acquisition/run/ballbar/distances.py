"""Checks that a distance belongs to the requested balls.

A ballbar gives a good reading between any two balls, so the reading is checked by other means:

    a leg after stage 1    the model of stage 1 says how long it must be: the bar on other balls, or a cup that moved
    two balls of one body  must read what they read before: a cup or a ball that moved
    the battery            is low before it is empty

Lengths mm.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from acquisition.cell.cell import Cell
from acquisition.errors import OtherBalls
from acquisition.record.device_serials import Individuals, series_among
from acquisition.record.readings import spans_of
from acquisition.record.store import PlannedReading, RecordStore
from calib.model import BoundModel, StatedConditions, conditions_at
from calib.saved import CalibratedModel, load_model
from drivers.interfaces import LengthReading

STAGE_1 = "stage1.json"
"""The model of stage 1, in the folder of the record."""
LEAST_MM, SIGMAS = 0.1, 6.0  # by which a leg may miss the model of stage 1, the larger of both
MOVED_MM = 0.03  # of a distance between two balls of one body: three kelvin move it by 0.01
LOW_PERCENT = 15.0


class BallbarChecks:
    """The checks of one execution."""

    def __init__(self, store: RecordStore, cell: Cell) -> None:
        self._store = store
        self._cell = cell
        self._battery_reported = False

    @cached_property
    def _stage(self) -> tuple[CalibratedModel, float]:
        """Return the model of stage 1, and the RMS of the residuals of its legs."""
        rows = self._store.database.query(
            "SELECT json_extract(data, '$.rms_mm') FROM event WHERE kind = 'second_stage' ORDER BY id DESC LIMIT 1"
        )
        return load_model(self.path), float(rows[0][0] or 0.0) if rows else 0.0

    @property
    def path(self) -> Path:
        """The file of the model of stage 1."""
        return self._store.database.path.parent / STAGE_1

    def expected(self, planned: PlannedReading) -> tuple[float, float] | None:
        """Return the expected length of a leg and its tolerance, mm.

        The result is None before stage 2, and for a reading that is not a leg.
        """
        if planned.base_target is None or not planned.visit.joints_deg or not self.path.is_file():
            return None
        saved, rms_mm = self._stage
        model = saved.model
        series = series_among(model.targets, Individuals(self._store).now())
        stated = StatedConditions(series=series, loads=self._cell.loads)
        joints = self._cell.robot.model_angles([planned.visit.joints_deg])
        conditions = conditions_at(model, joints, stated, planned.target)
        point = BoundModel(model, conditions).predict(saved.estimate)[0]
        ball = np.array(model.anchors[planned.base_target])
        for k, axis in enumerate("xyz"):
            position = model.index.get(f"{planned.base_target}.{axis}")
            ball[k] += 0.0 if position is None else saved.estimate[position]
        return float(np.linalg.norm(point - ball)), max(LEAST_MM, SIGMAS * rms_mm)

    def refuse_others(self, planned: PlannedReading, length_mm: float | None) -> None:
        """Check the length of a leg; None means out of stroke.

        Raises
        ------
        OtherBalls
            The length is not the expected one.
        """
        found = self.expected(planned)
        if found is None:
            return
        wanted, within = found
        stroke = self._cell.instrument.declared.stroke_mm or 0.0
        if length_mm is None and abs(wanted - self._cell.instrument.nominal_mm) + within > stroke:
            return  # it may well be out of stroke
        if length_mm is None or abs(length_mm - wanted) > within:
            shown = "is out of stroke" if length_mm is None else f"reads {length_mm:.3f} mm"
            raise OtherBalls(
                f"{planned.base_target} to {planned.target} {shown}; by the calibration of stage 1 it must be "
                f"{wanted:.3f} mm, give or take {within:.2g} mm",
                device="instrument",
                command="measure",
            )

    def moved(self, planned: PlannedReading) -> str | None:
        """Return a warning if a distance between two balls of one body has changed.

        It is compared with the first measurement.
        """
        lengths: dict[tuple[str, str], list[float]] = {}
        for row in spans_of(self._store):
            if row.counts and row.length_mm is not None and row.base_target is not None:
                lengths.setdefault((row.target, row.base_target), []).append(row.length_mm)
        own = lengths.get((planned.target, planned.base_target or ""), [])
        if len(own) < 2 or abs(own[-1] - own[0]) <= MOVED_MM:
            return None
        changed = [pair for pair, each in lengths.items() if abs(each[-1] - each[0]) > MOVED_MM]
        common = set(changed[0]).intersection(*changed) if len(changed) > 1 else set()
        who = f"{min(common)} has moved" if common else f"{planned.target} or {planned.base_target} has moved"
        return (
            f"{planned.target} to {planned.base_target} was {own[0]:.4f} mm and is {own[-1]:.4f} mm now: {who}, or the "
            "bar sits badly. Look at both; redo measures it again, confirm goes on."
        )

    def battery(self, reading: LengthReading) -> None:
        """Report once that the battery of the bar is low."""
        left = reading.battery_percent
        if left is not None and left < LOW_PERCENT and not self._battery_reported:
            self._battery_reported = True
            self._store.add_event("battery_low", percent=left)
