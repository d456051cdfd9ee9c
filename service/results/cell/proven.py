"""Result of a proof: the landings with the corrections of a model, and without."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from acquisition.loop import Targets, targets_csv
from acquisition.record import Verification
from calib.saved import CalibratedModel
from calib.text import replace_file
from service.files import as_json
from service.job_folder import MODEL, RESULT
from service.results.cell.loop_results import TARGETS, Verified
from service.results.shape import ResponseBody, document_of, told

FILES = (RESULT, MODEL, TARGETS)


class VerificationResult(ResponseBody):
    """The result of a proof."""

    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    simulated: Annotated[bool, told("Whether the landings are of simulators.", False)]
    held_out_rms_mm: Annotated[
        float | None,
        told("The model's own error on readings held out, RMS, mm; null: it states none.", 0.04),
    ]
    verification: Annotated[Verified, told("Where the robot landed.", {"ratio": 1.07})]


def write_proof(
    targets: Targets, verification: Verification, saved: CalibratedModel, folder: Path, simulated: bool
) -> dict[str, Any]:
    """Write targets and result of a proof, the result last, and return its document.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    result = VerificationResult(
        robot=saved.model.robot.name,
        simulated=simulated,
        held_out_rms_mm=saved.held_out_rms_mm,
        verification=Verified.model_validate(verification),
    )
    replace_file(folder / TARGETS, targets_csv(targets, saved.model.robot))
    document = document_of(result)
    replace_file(folder / RESULT, as_json(document))
    return document
