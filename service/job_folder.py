"""Folder of a job: names of its files, and the current step of the job."""

from __future__ import annotations

from pathlib import Path

JOB, RESULT, REPORT, MODEL, PROBLEM = "job.json", "result.json", "report.html", "model.json", "problem.json"
STEP, ARROWS, PROGRESS = "step.json", "arrows.json", "progress.json"
ROBOT, TRACKER, PICTURE, POSES = "robot.csv", "tracker.csv", "picture.svg", "poses.csv"
PRIOR = "prior.json"


def tell(folder: Path, step: str) -> None:
    """Publish the current step of the job."""
    from calib.text import replace_file
    from service.files import as_json

    replace_file(folder / STEP, as_json({"step": step}))
