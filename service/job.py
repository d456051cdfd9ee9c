"""One job, of any kind that `service.http.work.jobs` knows, for a worker of the service.

The folder of the job holds `job.json`; it gets `report.html` and then `result.json`, or `problem.json` where the data
cannot be used.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from service.job_folder import (
    ARROWS,
    JOB,
    MODEL,
    PICTURE,
    POSES,
    PRIOR,
    PROBLEM,
    PROGRESS,
    REPORT,
    RESULT,
    ROBOT,
    TRACKER,
    tell,
)


def do(folder: Path) -> None:
    """Do the job of a folder."""
    from calib.text import read_json, replace_file
    from service import refusals
    from service.files import as_json

    job = read_json(folder / JOB)
    try:
        if job["kind"] == "diagnosis":
            diagnosis(folder, job)
        elif job["kind"] == "alignment":
            alignment(folder, job["order"], job["name"])
        elif job["kind"] == "validation":
            validation(Path(job["data"]), folder, job["model"], job["order"])
        elif job["kind"] == "selection":
            selection(folder, job["cell"], job["order"])
        elif job["kind"] == "regression":
            regression(Path(job["data"]), folder, job["order"])
        elif job["kind"] == "placement":
            placement(folder, job["cell"], job["order"])
        elif job["kind"] in ("watch_plan", "watch", "upkeep"):
            from service import watch_job

            watch_job.do(folder, job)
        else:
            identification(folder, job)
    except refusals.REFUSALS as error:
        problem = {"text": refusals.cause(error), "do": refusals.remedy(error), **refusals.place(error)}
        replace_file(folder / PROBLEM, as_json(problem))


def diagnosis(folder: Path, job: Mapping[str, Any]) -> None:
    """Diagnose, save the model, draw the report. job: as `JobQueue.add` keeps it. Raises DataError."""
    from acquisition.cell import cell_of_record
    from calib.data import read_dataset
    from calib.diagnose import MOST_EFFECTS
    from calib.prior import load_prior
    from calib.saved import save_model
    from calib.text import replace_file
    from service.files import as_json
    from service.gc_pause import left_alone
    from service.report import diagnosis_report
    from service.results.cell.arrows import arrows_of
    from service.results.judgement.acceptance import AcceptanceLimits
    from service.results.models.diagnosed import DiagnosisOutcome, DiagnosisRequest

    dataset, cell, other = read_dataset(Path(job["data"])), job.get("cell"), job.get("carry_to")
    asked = DiagnosisRequest(
        most=job.get("most", MOST_EFFECTS),
        prior=load_prior(folder / PRIOR) if (folder / PRIOR).is_file() else None,
        carry_to=None if other is None else read_dataset(Path(other)),
        patch=job.get("patch", False),
        cell=None if cell is None else cell_of_record(cell, str(folder / JOB)),
        any_cell=True,
        limits=AcceptanceLimits.kept(job.get("limits")),
    )
    outcome = DiagnosisOutcome.of(dataset, asked, lambda step: tell(folder, step))
    found, document = outcome.diagnosis, outcome.document()
    tell(folder, "drawing the report")
    replace_file(folder / ARROWS, as_json(arrows_of(dataset, found.final)))
    sealed = None
    if found.final.converged:
        sealed = save_model(folder / MODEL, found.final, found, save_anyway=job.get("save_anyway", False))
    with left_alone():
        report = diagnosis_report(
            found,
            document,
            outcome.carried,
            outcome.patched,
            acceptance=outcome.acceptance,
            model_sha256=sealed,
        )
    replace_file(folder / REPORT, report)
    replace_file(folder / RESULT, as_json(document))


def identification(folder: Path, job: Mapping[str, Any]) -> None:
    """Identify, save the model, draw the report. job: as of a diagnosis. Raises DataError."""
    from calib.data import read_dataset
    from calib.prior import load_prior
    from calib.saved import refuse_worse, save_model
    from calib.text import replace_file
    from service.files import as_json
    from service.results.cell.arrows import arrows_of
    from service.results.judgement.acceptance import AcceptanceLimits
    from service.results.models.identified import IdentificationReport

    result = IdentificationReport.of(
        read_dataset(Path(job["data"])),
        job.get("level"),
        lambda step: tell(folder, step),
        AcceptanceLimits.kept(job.get("limits")),
        load_prior(folder / PRIOR) if (folder / PRIOR).is_file() else None,
    )
    replace_file(folder / ARROWS, as_json(arrows_of(result.dataset, result.found)))
    if not job.get("save_anyway", False):
        refuse_worse(result.error_nominal, result.error_identified)
    sealed = save_model(folder / MODEL, result.found) if result.found.converged else None
    replace_file(folder / REPORT, result.report(sealed))
    replace_file(folder / RESULT, as_json(result.document()))


def regression(data: Path, folder: Path, order: dict[str, Any]) -> None:
    """Compare regression with identification, save the model with its regression, draw the report. Raises DataError."""
    from calib.text import replace_file
    from service.files import as_json
    from service.results.models.regressed import RegressionOutcome

    result = RegressionOutcome.of(data, **order)
    sealed = result.save(folder / MODEL)
    replace_file(folder / REPORT, result.report(sealed))
    replace_file(folder / RESULT, as_json(result.document))


def validation(data: Path, folder: Path, model: str | None, order: dict[str, Any]) -> None:
    """Judge a model on a data set, or without one compare hold-outs. Raises DataError."""
    from calib.data import read_dataset
    from calib.saved import load_model
    from calib.text import replace_file
    from service.files import as_json
    from service.gc_pause import left_alone
    from service.report import validation_report
    from service.results.judgement.acceptance import AcceptanceLimits
    from service.results.judgement.validation import LoadedModel, ValidationRequest, validate
    from service.results.shape import document_of

    read = None
    if model is not None:
        read = LoadedModel(load_model(Path(model)), Path(model))
        if (other := order["compare"]) is not None:
            read = read._replace(second=load_model(Path(other["file"])), other=Path(other["id"]))
    point, limits = order["point"], AcceptanceLimits.kept(order["limits"])
    asked = ValidationRequest(
        order["place"], order["everything"], None if point is None else tuple(point), limits
    )
    found = validate(read_dataset(data), read, asked, lambda step: tell(folder, step))
    if read is not None and not asked.everything:
        with left_alone():
            report = validation_report(found)
        replace_file(folder / REPORT, report)
    replace_file(folder / RESULT, as_json(document_of(found.result)))


def selection(folder: Path, cell: str, order: dict[str, Any]) -> None:
    """Choose poses in the cell of this text. Raises DataError, ConfigError."""
    from acquisition.cell import cell_of_record
    from calib.prior import load_prior
    from calib.text import replace_file
    from service.files import as_json
    from service.results.cell.selected import Selected, SelectionRequest

    for name in ("groups", "targets"):
        order[name] = None if order[name] is None else tuple(order[name])
    prior = load_prior(folder / PRIOR) if (folder / PRIOR).is_file() else None
    found = Selected.of(cell_of_record(cell, str(folder / JOB)), SelectionRequest(**order, prior=prior))
    replace_file(folder / POSES, found.csv)
    replace_file(folder / RESULT, as_json(found.document()))


def placement(folder: Path, cell: str, order: dict[str, Any]) -> None:
    """Search placements of the base balls, draw them. cell: the text of a cell file. Raises DataError."""
    from acquisition.cell import cell_of_record
    from calib.errors import DataError
    from calib.text import replace_file
    from drivers.errors import ConfigError
    from service.files import as_json
    from service.results.cell.placements import PlacementRequest, found_for

    def progress(done: int, total: int) -> None:
        replace_file(folder / PROGRESS, as_json({"done": done, "total": total}))

    def say(_: str) -> None:
        """Ignore sentences: the progress shows the step."""

    try:
        found = found_for(
            cell_of_record(cell, str(folder / JOB)), PlacementRequest.of(order), folder / JOB, say, progress
        )
    except ConfigError as error:
        raise DataError(f"{error.message}.", do=error.what_to_do, key="zone") from error
    replace_file(folder / PICTURE, found.picture())
    replace_file(folder / RESULT, as_json(found.document()))


def alignment(folder: Path, order: dict[str, Any], name: str) -> None:
    """Align the streams of the folder, keep their standstills as a data set, draw the picture. Raises DataError."""
    from calib.text import replace_file
    from service.files import as_json
    from service.kept_dataset import CSV, keep_dataset
    from service.report.figures.motion import motion_picture
    from service.results.files.alignment import aligned_of, document
    from service.results.files.alignment_request import AlignmentRequest

    result = aligned_of(
        folder / ROBOT, folder / TRACKER, AlignmentRequest(**{**order, "tool": tuple(order["tool"])})
    )
    replace_file(folder / PICTURE, motion_picture(result))
    kept = keep_dataset(folder.parents[1] / "datasets", lambda at: result.table.write(at / CSV), name)
    replace_file(folder / RESULT, as_json({**document(result), "dataset_id": kept["id"]}))
