"""Plans of watches, watches and upkeeps for the service, jobs as those of `service.job`; the baseline lies in their
folder.

Imports come late, as there.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from service.job_folder import JOB, MODEL, RESULT, tell

MEANS = "watch-means"
"""The folder of the record with the lines of earlier watches, a file a baseline."""


def do(folder: Path, job: Mapping[str, Any]) -> None:
    """Do the job of a folder; its result. Raises DataError, ConfigError."""
    from calib.errors import DataError
    from calib.text import replace_file
    from drivers.errors import ConfigError
    from service.files import as_json

    made = {"watch_plan": plan, "watch": watch, "upkeep": upkeep}[job["kind"]]
    try:
        document = made(folder, job)
    except ConfigError as error:
        raise DataError(f"{error.message}.", do=error.what_to_do, key="poses") from error
    replace_file(folder / RESULT, as_json(document))


def plan(folder: Path, job: Mapping[str, Any]) -> dict[str, Any]:
    """Choose check poses in the cell of the job; the plan, with its campaign. Raises DataError, ConfigError."""
    from acquisition.cell import cell_of_record
    from calib.saved import load_model
    from calib.text import parse_toml
    from service.results.watch_plan import PlannedWatch, WatchPlanRequest

    order, baseline = job["order"], folder / job["baseline"]["file"]
    targets = order.pop("targets")
    asked = WatchPlanRequest(**order, targets=tuple(targets) if targets else None)
    cell = cell_of_record(job["cell"], str(folder / JOB))
    found = PlannedWatch.of(
        cell, folder / JOB, load_model(baseline), baseline, asked, lambda step: tell(folder, step)
    )
    ((_, text),) = found.files(folder / "watch.toml").items()
    return found.document() | {"campaign": parse_toml(text, "watch.toml")}


def watch(folder: Path, job: Mapping[str, Any]) -> dict[str, Any]:
    """Judge a data set by the baseline, write the updated model; the verdict. Raises DataError."""
    from calib.data import read_dataset
    from calib.saved import load_model
    from service.results.watched import WatchRequest, WatchResultSummary

    order, baseline = job["order"], folder / job["baseline"]["file"]
    means = None
    if order.pop("average"):
        means = folder.parents[1] / MEANS / f"{job['baseline']['sha256']}.jsonl"
        means.parent.mkdir(exist_ok=True)
    asked = WatchRequest(means, folder / MODEL, **order)
    found = WatchResultSummary.of(
        read_dataset(Path(job["data"])),
        load_model(baseline),
        baseline,
        asked,
        lambda step: tell(folder, step),
    )
    # A place of the server, and another one every time: the same verdict is to be the same document.
    return found.document() | {"updated_model": MODEL if found.updated else None}


def upkeep(folder: Path, job: Mapping[str, Any]) -> dict[str, Any]:
    """Judge how warm the arm is, write the updated model; what was found. Raises DataError."""
    from calib.data import read_dataset
    from calib.saved import load_model
    from service.results.upkept import ThermalUpdateRequest, ThermalUpdateSummary

    baseline = folder / job["baseline"]["file"]
    asked = ThermalUpdateRequest(folder / MODEL, **job["order"])
    found = ThermalUpdateSummary.of(
        read_dataset(Path(job["data"])),
        load_model(baseline),
        baseline,
        asked,
        lambda step: tell(folder, step),
    )
    return found.document() | {"updated_model": MODEL if found.thermal else None}
