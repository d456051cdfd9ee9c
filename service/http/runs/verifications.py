"""Proofs of saved models: new poses on the robot, with the corrections and without.

`RECORD/verifications/ID/` has `loop.json`, `asked.json`, a copy of the model and the results. The campaigns of a proof
are runs like any others (`RECORD/runs/ID-campaign1`). A proof that was cut off is resumed as a loop is.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from acquisition import Cell, LeaseDeadline, State
from acquisition.loop import Equipment, ProofPlan, Say, clock_of, plan_of_proof, prove, usable_here
from calib.saved import CalibratedModel, load_model
from calib.text import replace_file
from service.files import as_json
from service.http.runs.loop_work import LoopStatus, Play
from service.http.runs.loops import ASKED, WorkStore
from service.http.wire.bodies import VerificationAsked
from service.http.work.stored_documents import readable
from service.job_folder import MODEL
from service.results.cell.proven import write_proof


class VerificationStore(WorkStore):
    """The proofs of one record directory."""

    kind, fitted = "verification", ()
    asked = VerificationAsked

    def document(self, name: str) -> dict[str, Any]:
        """Return the document of a proof, with its order and that of the current run.

        Raises
        ------
        Problem
            404, or 500 if it is damaged.
        """
        shown, asked = super().document(name), self._asked(name)
        return shown | {key: asked[key] for key in ("model_id", "poses", "seed")}

    def make(
        self,
        cell: Cell,
        model: Path | Mapping[str, Any],
        asked: Mapping[str, Any],
        name: str,
        *,
        dry_run: bool,
    ) -> LoopStatus:
        """Check a proof: its model, and everything that it will drive. Nothing is opened.

        Parameters
        ----------
        model
            The file of the model, or its content.
        asked
            `model_id`, `poses` and `seed`.

        Raises
        ------
        DataError, ConfigError, UnsafePlan
            The model cannot be proved in this cell, or no pose can be driven.
        """
        status = self._new(name or cell.name, State.SUCCEEDED if dry_run else State.RUNNING, dry_run=dry_run)
        folder = self._folder / status.id
        try:
            text = model.read_text("utf-8") if isinstance(model, Path) else json.dumps(model)
            replace_file(folder / MODEL, text)
            replace_file(folder / ASKED, as_json({**asked, "cell": cell.source}))
            found = self._workers.call(
                checked, folder / MODEL, cell, asked["poses"], asked["seed"], self._simulated
            )
        except BaseException:
            shutil.rmtree(folder)
            raise
        if dry_run:
            self._write(
                status.as_dict() | {"reason": f"Checked only: {found.in_words()}; nothing has moved."}
            )
        return status

    def start(self, status: LoopStatus, cell: Cell, lease: LeaseDeadline) -> str:
        """Begin a proof that was checked; the robot moves.

        Raises
        ------
        Problem
            409: the robot is busy.
        """
        return self._start(status, cell, lease)

    def _play(self, status: LoopStatus, cell: Cell) -> Play:
        folder, asked = self._folder / status.id, self._asked(status.id)

        def play(equipment: Equipment, say: Say) -> None:
            saved = equipment.compute(model_of, folder / MODEL, cell, equipment.simulated)
            targets, found = prove(
                equipment, saved, folder, poses=asked["poses"], seed=asked["seed"], say=say
            )
            equipment.compute(write_proof, targets, found, saved, folder, equipment.simulated)

        return play

    def forget(self, status: LoopStatus) -> None:
        """Remove a proof that was checked and did not begin."""
        shutil.rmtree(self._folder / status.id, ignore_errors=True)

    def verified_rms_mm(self, model_id: str) -> float | None:
        """Return the RMS error of the robot in the last proof of a model, mm; None without one."""
        for each in readable(self.ids(), self.document):  # newest first
            if each["model_id"] == model_id and each["result"] is not None:
                return each["result"]["verification"]["error_verified_mm"]["rms"]
        return None


def model_of(file: Path, cell: Cell, simulated: bool) -> CalibratedModel:
    """Read a model and return it as this cell can prove it.

    Raises
    ------
    DataError, ConfigError
        It cannot be proved here.
    """
    return usable_here(cell, load_model(file), file, simulated=simulated)


def checked(file: Path, cell: Cell, poses: int, seed: int, simulated: bool) -> ProofPlan:
    """Check what a proof of a model will drive.

    Raises
    ------
    DataError, ConfigError, UnsafePlan
        It cannot be driven.
    """
    saved = model_of(file, cell, simulated)
    since_s = clock_of(saved, time.time(), cell.time_scale if simulated else 1.0)
    return plan_of_proof(cell, saved, poses, seed, since_s)
