"""One job, of any kind that `service.http.work.jobs` knows, for a worker of the service.

The folder of the job holds `job.json`. The job adds `report.html` and then `result.json`, or `problem.json` if the data
cannot be used.

Each function below takes the folder and the job as `Jobs.add` stores it. It raises `DataError`, or `ConfigError` for a
cell, if the job cannot be done; `do` writes the error to `problem.json`.
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
    """Do the job of a folder. A refusal is written to `problem.json`."""
    from calib.text import read_json, replace_file
    from service import refusals
    from service.files import as_json

    job = read_json(folder / JOB)
    try:
        _WORK[job["kind"]](folder, job)
    except refusals.REFUSALS as error:
        problem = {"text": refusals.cause(error), "do": refusals.remedy(error), **refusals.place(error)}
        replace_file(folder / PROBLEM, as_json(problem))


def diagnosis(folder: Path, job: Mapping[str, Any]) -> None:
    """Diagnose a data set, save the model and write the report."""
    from acquisition.cell import cell_of_record
    from calib.data import read_dataset
    from calib.diagnose import MOST_EFFECTS
    from calib.prior import load_prior
    from calib.saved import save_model
    from calib.text import replace_file
    from service.files import as_json
    from service.gc_pause import left_alone
    from service.report import diagnosis_report
    from service.results.cell.arrows import ArrowsShown
    from service.results.judgement.acceptance import AcceptanceLimits
    from service.results.models.diagnosed import DiagnosisOutcome, DiagnosisRequest
    from service.results.shape import document_of

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
    replace_file(folder / ARROWS, as_json(document_of(ArrowsShown.of(dataset, found.final))))
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
    """Identify a robot, save the model and write the report."""
    from calib.data import read_dataset
    from calib.prior import load_prior
    from calib.saved import refuse_worse, save_model
    from calib.text import replace_file
    from service.files import as_json
    from service.results.cell.arrows import ArrowsShown
    from service.results.judgement.acceptance import AcceptanceLimits
    from service.results.models.identified import IdentificationReport
    from service.results.shape import document_of

    result = IdentificationReport.of(
        read_dataset(Path(job["data"])),
        job.get("level"),
        lambda step: tell(folder, step),
        AcceptanceLimits.kept(job.get("limits")),
        load_prior(folder / PRIOR) if (folder / PRIOR).is_file() else None,
    )
    replace_file(folder / ARROWS, as_json(document_of(ArrowsShown.of(result.dataset, result.found))))
    if not job.get("save_anyway", False):
        refuse_worse(result.error_nominal, result.error_identified)
    sealed = save_model(folder / MODEL, result.found) if result.found.converged else None
    document = result.document()
    replace_file(folder / REPORT, result.report(document, sealed))
    replace_file(folder / RESULT, as_json(document))


def regression(folder: Path, job: Mapping[str, Any]) -> None:
    """Compare regression and identification, save model and regression, and write the report."""
    from calib.text import replace_file
    from service.files import as_json
    from service.report import regression_report
    from service.results.models.regressed import RegressionOutcome
    from service.results.shape import document_of

    result = RegressionOutcome.of(Path(job["data"]), **job["order"])
    sealed = result.save(folder / MODEL)
    replace_file(folder / REPORT, regression_report(result.comparison, result.result, sealed))
    replace_file(folder / RESULT, as_json(document_of(result.result)))


def validation(folder: Path, job: Mapping[str, Any]) -> None:
    """Judge a model on a data set, or compare hold-outs if no model is given."""
    from calib.data import read_dataset
    from calib.saved import load_model
    from calib.text import replace_file
    from service.files import as_json
    from service.gc_pause import left_alone
    from service.report import validation_report
    from service.results.judgement.acceptance import AcceptanceLimits
    from service.results.judgement.validation import LoadedModel, ValidationRequest, validate
    from service.results.shape import document_of

    order, model, read = job["order"], job["model"], None
    if model is not None:
        read = LoadedModel(load_model(Path(model)), Path(model))
        if (other := order["compare"]) is not None:
            read = read._replace(second=load_model(Path(other["file"])), other=Path(other["id"]))
    point, limits = order["point"], AcceptanceLimits.kept(order["limits"])
    asked = ValidationRequest(
        order["place"], order["everything"], None if point is None else tuple(point), limits
    )
    found = validate(read_dataset(Path(job["data"])), read, asked, lambda step: tell(folder, step))
    if read is not None and not asked.everything:
        with left_alone():
            report = validation_report(found)
        replace_file(folder / REPORT, report)
    replace_file(folder / RESULT, as_json(document_of(found.result)))


def sweeps(folder: Path, job: Mapping[str, Any]) -> None:
    """Analyse the sweeps of a data set and draw their tangential errors."""
    from calib.data import read_dataset
    from calib.text import replace_file
    from service.files import as_json
    from service.report.figures.sweeps import sweeps_picture
    from service.results.models.swept import SweepsResult
    from service.results.shape import document_of

    found = SweepsResult.of(read_dataset(Path(job["data"])), job["level"], lambda step: tell(folder, step))
    replace_file(folder / PICTURE, sweeps_picture(found.sweeps))
    replace_file(folder / RESULT, as_json(document_of(found)))


def selection(folder: Path, job: Mapping[str, Any]) -> None:
    """Choose poses in the cell of the job."""
    from acquisition.cell import cell_of_record
    from calib.prior import load_prior
    from calib.text import replace_file
    from service.files import as_json
    from service.results.cell.selected import Selected, SelectionRequest

    order = dict(job["order"])
    for name in ("groups", "targets"):
        order[name] = None if order[name] is None else tuple(order[name])
    prior = load_prior(folder / PRIOR) if (folder / PRIOR).is_file() else None
    found = Selected.of(
        cell_of_record(job["cell"], str(folder / JOB)), SelectionRequest(**order, prior=prior)
    )
    replace_file(folder / POSES, found.csv)
    replace_file(folder / RESULT, as_json(found.document()))


def placement(folder: Path, job: Mapping[str, Any]) -> None:
    """Search placements of the base balls and draw them."""
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
            cell_of_record(job["cell"], str(folder / JOB)),
            PlacementRequest.of(job["order"]),
            folder / JOB,
            say,
            progress,
        )
    except ConfigError as error:
        raise DataError(f"{error.message}.", do=error.what_to_do, key="zone") from error
    replace_file(folder / PICTURE, found.picture())
    replace_file(folder / RESULT, as_json(found.document()))


def alignment(folder: Path, job: Mapping[str, Any]) -> None:
    """Align the streams of the folder, and store their stationary intervals as a data set."""
    from calib.text import replace_file
    from service.files import as_json
    from service.kept_dataset import CSV, keep_dataset
    from service.report.figures.motion import motion_picture
    from service.results.files.alignment import AlignmentResult, aligned_of
    from service.results.files.alignment_request import AlignmentRequest
    from service.results.shape import document_of

    result = aligned_of(
        folder / ROBOT,
        folder / TRACKER,
        AlignmentRequest(**{**job["order"], "tool": tuple(job["order"]["tool"])}),
    )
    replace_file(folder / PICTURE, motion_picture(result))
    kept = keep_dataset(folder.parents[1] / "datasets", lambda at: result.table.write(at / CSV), job["name"])
    replace_file(
        folder / RESULT, as_json(document_of(AlignmentResult.of(result)) | {"dataset_id": kept["id"]})
    )


def watch_plan(folder: Path, job: Mapping[str, Any]) -> None:
    """Choose check poses in the cell of the job, and write the plan with its campaign."""
    from acquisition.cell import cell_of_record
    from calib.errors import DataError
    from calib.saved import load_model
    from calib.text import parse_toml, replace_file
    from drivers.errors import ConfigError
    from service.files import as_json
    from service.results.shape import document_of
    from service.results.watch_plan import PlannedWatch, WatchPlanRequest

    baseline, targets = folder / job["baseline"]["file"], job["order"]["targets"]
    asked = WatchPlanRequest(**{**job["order"], "targets": tuple(targets) if targets else None})
    try:
        cell = cell_of_record(job["cell"], str(folder / JOB))
        found = PlannedWatch.of(
            cell, folder / JOB, load_model(baseline), baseline, asked, lambda step: tell(folder, step)
        )
    except ConfigError as error:
        raise DataError(f"{error.message}.", do=error.what_to_do, key="poses") from error
    ((_, text),) = found.files(folder / "watch.toml").items()
    document = document_of(found.result) | {"campaign": parse_toml(text, "watch.toml")}
    replace_file(folder / RESULT, as_json(document))


def watch(folder: Path, job: Mapping[str, Any]) -> None:
    """Judge a data set by the baseline, and write the verdict and the updated model."""
    from calib.data import read_dataset
    from calib.saved import load_model
    from calib.text import replace_file
    from service.files import as_json
    from service.results.shape import document_of
    from service.results.watched import WatchRequest, watch_result

    order, baseline = dict(job["order"]), folder / job["baseline"]["file"]
    means = None
    if order.pop("average"):
        means = folder.parents[1] / "watch-means" / f"{job['baseline']['sha256']}.jsonl"
        means.parent.mkdir(exist_ok=True)
    asked = WatchRequest(means, folder / MODEL, **order)
    found = watch_result(
        read_dataset(Path(job["data"])),
        load_model(baseline),
        baseline,
        asked,
        lambda step: tell(folder, step),
    )
    # A place of the server, and another one every time: the same verdict is to be the same document.
    document = document_of(found) | {"updated_model": found.updated_model and MODEL}
    replace_file(folder / RESULT, as_json(document))


def upkeep(folder: Path, job: Mapping[str, Any]) -> None:
    """Judge the thermal state of the arm, and write the result and the updated model."""
    from calib.data import read_dataset
    from calib.saved import load_model
    from calib.text import replace_file
    from service.files import as_json
    from service.results.shape import document_of
    from service.results.upkept import ThermalUpdateRequest, upkeep_result

    baseline = folder / job["baseline"]["file"]
    asked = ThermalUpdateRequest(folder / MODEL, **job["order"])
    found = upkeep_result(
        read_dataset(Path(job["data"])),
        load_model(baseline),
        baseline,
        asked,
        lambda step: tell(folder, step),
    )
    document = document_of(found) | {"updated_model": found.updated_model and MODEL}
    replace_file(folder / RESULT, as_json(document))


_WORK = {
    "alignment": alignment,
    "diagnosis": diagnosis,
    "identification": identification,
    "placement": placement,
    "regression": regression,
    "selection": selection,
    "sweeps": sweeps,
    "upkeep": upkeep,
    "validation": validation,
    "watch": watch,
    "watch_plan": watch_plan,
}
