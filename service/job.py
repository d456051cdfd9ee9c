"""One identification, diagnosis, alignment, regression or search of placements, for a worker process of the service.

The folder of the job holds `job.json`; it gets `report.html` and then `result.json`, or `problem.json` where the data
cannot be used.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

JOB, RESULT, REPORT, MODEL, PROBLEM = "job.json", "result.json", "report.html", "model.json", "problem.json"
ROBOT, TRACKER, PICTURE, PROGRESS = "robot.csv", "tracker.csv", "picture.svg", "progress.json"


def do(folder: Path) -> None:
    """Do the job of a folder."""
    from calib.errors import DataError
    from calib.text import read_json, replace_file
    from service import refusals
    from service.files import as_json

    job = read_json(folder / JOB)
    try:
        if job["kind"] == "diagnosis":
            diagnosis(Path(job["data"]), folder, cell=job.get("cell"))
        elif job["kind"] == "alignment":
            alignment(folder, job["order"], job["name"])
        elif job["kind"] == "regression":
            regression(Path(job["data"]), folder, job["order"])
        elif job["kind"] == "placement":
            placement(folder, job["cell"], job["order"])
        else:
            identification(Path(job["data"]), folder)
    except DataError as error:
        problem = {"text": refusals.cause(error), "do": error.do, **refusals.place(error)}
        replace_file(folder / PROBLEM, as_json(problem))


def diagnosis(data: Path, folder: Path, *, cell: str | None = None) -> None:
    """Diagnose, save the model, draw the report. cell: text of the cell that could measure more. Raises DataError."""
    from dataclasses import replace

    from acquisition.cell import cell_of_record
    from acquisition.loop import fits, in_cell
    from calib.data import read_dataset
    from calib.diagnose import diagnose
    from calib.saved import save_model
    from calib.text import replace_file
    from service.files import as_json
    from service.report import diagnosis_report
    from service.results import documents

    found = diagnose(read_dataset(data))
    here = None if cell is None else cell_of_record(cell, str(folder / JOB))
    if here is not None and found.follow_up is not None and fits(here, found.final):
        found = replace(found, follow_up=in_cell(here, found.final, found.follow_up.rivals))
    document = documents.of_diagnosis(found)
    if found.final.converged:
        save_model(folder / MODEL, found.final, found)
    replace_file(folder / REPORT, diagnosis_report(found, document))
    replace_file(folder / RESULT, as_json(document))


def identification(data: Path, folder: Path) -> None:
    """Identify, save the model, draw the report. Raises DataError."""
    from calib.saved import save_model
    from calib.text import replace_file
    from service.files import as_json
    from service.results.identified import Identified

    result = Identified.of(data)
    if result.found.converged:
        save_model(folder / MODEL, result.found)
    replace_file(folder / REPORT, result.report())
    replace_file(folder / RESULT, as_json(result.document()))


def regression(data: Path, folder: Path, order: dict[str, Any]) -> None:
    """Compare regression with identification, save the model with its regression, draw the report. Raises DataError."""
    from calib.text import replace_file
    from service.files import as_json
    from service.results.regressed import Regressed

    result = Regressed.of(data, **order)
    result.save(folder / MODEL)
    replace_file(folder / REPORT, result.report())
    replace_file(folder / RESULT, as_json(result.document))


def placement(folder: Path, cell: str, order: dict[str, Any]) -> None:
    """Search placements of the base balls, draw them. cell: the text of a cell file. Raises DataError."""
    from acquisition.cell import cell_of_record
    from calib.errors import DataError
    from calib.text import replace_file
    from drivers.errors import ConfigError
    from service.files import as_json
    from service.results.placements import Order, found_for

    def progress(done: int, total: int) -> None:
        replace_file(folder / PROGRESS, as_json({"done": done, "total": total}))

    def say(_: str) -> None:
        """What is done is in the progress."""

    try:
        found = found_for(
            cell_of_record(cell, str(folder / JOB)), Order.of(order), folder / JOB, say, progress
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
    from service.report.motion import motion_picture
    from service.results.alignment import Order, aligned_of, document

    result = aligned_of(folder / ROBOT, folder / TRACKER, Order(**{**order, "tool": tuple(order["tool"])}))
    replace_file(folder / PICTURE, motion_picture(result))
    kept = keep_dataset(folder.parents[1] / "datasets", lambda at: result.table.write(at / CSV), name)
    replace_file(folder / RESULT, as_json({**document(result), "dataset_id": kept["id"]}))
