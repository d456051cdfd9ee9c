"""The second stage of a ballbar campaign: legs out of stroke, at corrected joints.

    stage 1 -> distances within the stroke -> identification -> corrected joints for the poses of the others -> stage 2

A robot misses its poses by millimetres, and the stroke of the bar is one. The model of stage 1 need not be good: it
brings the tool near enough for the bar to measure the other legs. The model does not enter the data set, which has the
joints as commanded. It is kept in the folder of the record, `stage1.json`, to predict the lengths of the legs of
stage 2 (`run.ballbar.distances`), and to be compared with the final one: the thesis found it better for front/up.
Source: Nubiola, thesis, section 4.4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from acquisition.campaign.blocks.block import rounded
from acquisition.campaign.blocks.hexapod import HexapodBlock
from acquisition.campaign.blocks.sphere import SphereBlock
from acquisition.campaign.campaign import Campaign
from acquisition.campaign.plan import Visit
from acquisition.cell.cell import Cell
from acquisition.cell.transit import may_visit
from acquisition.cell.workspace import Array
from acquisition.errors import RecordError, StorageError
from acquisition.record.device_serials import Individuals, series_among
from acquisition.record.export import table_of
from acquisition.record.store import PlannedReading, RecordStore
from acquisition.run.ballbar.distances import STAGE_1
from calib.compensate import correct
from calib.errors import DataError
from calib.fit import IdentificationFit, identify
from calib.model import BoundModel, StatedConditions
from calib.saved import save_model
from drivers.errors import OutOfRange

_LAST_ERROR = "SELECT error_code FROM attempt WHERE pose = ? AND status = 'failed' ORDER BY id DESC LIMIT 1"


class SecondStage:
    """The second stage of one record.

    `placed` returns the cell with its cups where they were touched.
    """

    def __init__(
        self, store: RecordStore, cell: Cell, campaign: Campaign, placed: Callable[[], Cell] | None = None
    ) -> None:
        self._store = store
        self._cell = cell
        self._placed = placed or (lambda: cell)
        self._blocks = {
            i
            for i, block in enumerate(campaign.blocks)
            if isinstance(block, HexapodBlock | SphereBlock)
            and block.lengths
            and block.stages == 2
            and block.model is None  # its joints are corrected already
        }

    def plan(self) -> None:
        """Plan the readings that were out of stroke again, at corrected joints.

        They stay as they were if the readings cannot determine a model, or a corrected pose may not be driven.

        Raises
        ------
        StorageError
            The record cannot be written.
        """
        left = self._out_of_stroke()
        if not left:
            return
        visits = list({planned.visit.number: planned.visit for planned in left}.values())
        try:
            fitted = self._fitted()
            self._keep(fitted)
            joints = self._corrected(fitted, visits)
        except (DataError, RecordError) as error:  # too few readings, or none
            self._store.add_event("second_stage_refused", readings=len(left), reason=str(error))
            return
        number = max(planned.visit.number for planned in self._store.plan())
        with self._store.changing():
            done = 0
            for visit, pose in zip(visits, joints, strict=True):
                if np.all(np.isfinite(pose)):
                    number, done = number + 1, done + 1
                    self._store.replan(
                        [planned for planned in left if planned.visit == visit],
                        self._moved(visit, pose, number),
                    )
            self._store.add_event(
                "second_stage",
                rms_mm=_rms_mm(fitted),
                readings_fitted=len(fitted.readings.conditions.joints),
                noise_scale=fitted.noise_scale,
                poses=done,
                refused=len(visits) - done,
            )

    def _out_of_stroke(self) -> list[PlannedReading]:
        query = self._store.database.query
        return [
            planned
            for planned in self._store.plan()
            if planned.status == "deferred"
            and planned.visit.block in self._blocks
            and any(row[0] == OutOfRange.code for row in query(_LAST_ERROR, (planned.id,)))
        ]

    def _fitted(self) -> IdentificationFit:
        return identify(table_of(self._store.database.path.parent).dataset())

    def _keep(self, fitted: IdentificationFit) -> None:
        """Save the model of stage 1.

        Raises
        ------
        DataError
            The fit did not converge.
        StorageError
            The file cannot be written.
        """
        try:
            save_model(self._store.database.path.parent / STAGE_1, fitted)
        except OSError as error:
            raise StorageError(f"{STAGE_1}: {error.strerror or error}") from error

    def _corrected(self, fitted: IdentificationFit, visits: list[Visit]) -> Array:
        """Compute the corrected joints (k, N), deg; NaN for a pose that may not be driven."""
        robot = self._cell.robot
        goals = np.array([visit.joints_deg for visit in visits])
        series = series_among(fitted.model.targets, Individuals(self._store).now())
        correction = correct(
            fitted.model,
            fitted.estimate,
            robot.model_angles(goals),
            StatedConditions(series=series, loads=self._cell.loads),
            limits=robot.limits,
            coupling=robot.coupling,
        )
        joints = robot.counted(correction.joints)
        approach = joints + np.array([np.subtract(v.approach_deg, v.joints_deg) for v in visits])
        known = np.all(np.isfinite(joints), axis=1)
        clear = may_visit(self._placed(), np.nan_to_num(joints), np.nan_to_num(approach))
        return np.where((known & clear)[:, None], joints, np.nan)

    def _moved(self, visit: Visit, joints_deg: Array, number: int) -> Visit:
        offset = np.subtract(visit.approach_deg, visit.joints_deg)
        pose = rounded(joints_deg)
        return replace(
            visit,
            number=number,
            name=f"{visit.name}, corrected",
            joints_deg=pose,
            approach_deg=rounded(np.array(pose) + offset),
        )


def _rms_mm(fitted: IdentificationFit) -> float:
    """Compute the RMS of the residuals of a fit's legs, mm."""
    readings = fitted.readings
    frames = BoundModel(fitted.model, readings.conditions).frames(fitted.estimate, ())
    lengths = readings.observed.lengths
    assert lengths is not None  # of a ballbar
    return float(np.sqrt(np.mean((lengths - np.linalg.norm(frames.p - frames.anchor, axis=0)) ** 2)))
