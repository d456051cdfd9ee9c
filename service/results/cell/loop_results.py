"""The results of a closed loop: result, model, corrected targets and report, in one folder.

result.json  model.json  targets.csv  report.html, beside data.csv and data.toml of the loop
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from acquisition.loop import LoopResult, targets_csv
from calib.saved import save_model
from calib.text import replace_file
from service.files import as_json
from service.job_folder import ARROWS, MODEL, REPORT, RESULT
from service.results.cell.arrows import arrows_of
from service.results.models import documents

TARGETS = "targets.csv"


def write(result: LoopResult, folder: Path, *, name: str = RESULT) -> dict[str, Any]:
    """Write them, the result as `name` and last, so that with it everything is there. Returns it. Raises OSError."""
    from service.report import diagnosis_report  # drawing takes long to import

    document = document_of(result)
    final, sealed = result.diagnosis.final, None
    if final.converged:
        sealed = save_model(folder / MODEL, final, result.diagnosis)
    replace_file(folder / TARGETS, targets_csv(result.targets, result.diagnosis.dataset.header.robot))
    replace_file(
        folder / REPORT,
        diagnosis_report(
            result.diagnosis,
            document,
            verified=result.verification,
            followed_up=result.followed_up,
            model_sha256=sealed,
        ),
    )
    replace_file(folder / ARROWS, as_json(arrows_of(result.diagnosis.dataset, final)))
    replace_file(folder / name, as_json(document))
    return document


def document_of(result: LoopResult) -> dict[str, Any]:
    """The diagnosis (`truepose-diagnosis/1`) with `verification`, and `followed_up` where poses were added."""
    from service.report.sections import verification

    document = documents.of_diagnosis(result.diagnosis) | {
        "verification": verification.document_of(result.verification),
    }
    if result.followed_up is not None:
        document["followed_up"] = documents.of_middle_step(result.followed_up)
    return document
