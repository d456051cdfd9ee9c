"""One identification or diagnosis, for a worker process of the service.

The folder of the job holds `job.json`; it gets `report.html` and then `result.json`, or `problem.json` where the data
cannot be used.
"""

from __future__ import annotations

from pathlib import Path

JOB, RESULT, REPORT, MODEL, PROBLEM = "job.json", "result.json", "report.html", "model.json", "problem.json"


def do(folder: Path) -> None:
    """Do the job of a folder."""
    from calib.errors import DataError
    from calib.files import replace_file
    from calib.json_text import read_json
    from service.files import as_json
    from service.http.problems import data_place, data_text

    job = read_json(folder / JOB)
    try:
        if job["kind"] == "diagnosis":
            diagnosis(Path(job["data"]), folder, cell=job.get("cell"))
        else:
            identification(Path(job["data"]), folder)
    except DataError as error:
        problem = {"text": data_text(error), "do": error.do, **data_place(error)}
        replace_file(folder / PROBLEM, as_json(problem))


def diagnosis(data: Path, folder: Path, *, cell: str | None = None) -> None:
    """Diagnose, save the model, draw the report. cell: text of the cell that could measure more. Raises DataError."""
    from dataclasses import replace

    from acquisition.cell import cell_of_record
    from acquisition.follow_up import fits, in_cell
    from calib.dataset import read_dataset
    from calib.diagnose.diagnosis import diagnose
    from calib.files import replace_file
    from calib.model_file import save_model
    from service import documents
    from service.files import as_json
    from service.report import diagnosis_report

    found = diagnose(read_dataset(data))
    here = None if cell is None else cell_of_record(cell, str(folder / JOB))
    if here is not None and found.follow_up is not None and fits(here, found.final):
        found = replace(found, follow_up=in_cell(here, found.final, found.follow_up.rivals))
    document = documents.of_diagnosis(found)
    save_model(folder / MODEL, found.final, found)
    replace_file(folder / REPORT, diagnosis_report(found, document))
    replace_file(folder / RESULT, as_json(document))


def identification(data: Path, folder: Path) -> None:
    """Identify, save the model, draw the report. Raises DataError."""
    from service.commands.identify import identify_command

    # The command writes its JSON last, so a result always has its report.
    identify_command(data, json=str(folder / RESULT), model=folder / MODEL, report=folder / REPORT)
