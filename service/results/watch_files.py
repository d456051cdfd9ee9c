"""The files of a plan of a watch: the campaign of its check poses, or the data set that a person fills in."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from acquisition import Cell
from acquisition.campaign import Pose
from acquisition.record import planned_header
from calib.errors import DataError
from calib.watch import Visits
from service.results.watch_question import PlanQuestion

NOT_TOUCHED = "rejected:not touched yet"


def campaign_of(
    model: str,
    asked: PlanQuestion,
    targets: Sequence[str],
    poses: Sequence[Pose],
    visits: Visits,
    repeats: int,
    nest_limit_mm: float | None,
    robot: Mapping[str, str],
) -> str:
    """The campaign that visits the poses in their order; repeats: how often each target is read
    there; nest_limit_mm: of the nests that are measured again half-way,
    None where none are; robot: the device that the baseline is of."""
    block: dict[str, Any] = {
        "set": "calibration",
        "joints_deg": [list(pose.joints_deg) for pose in poses],
        "approach_sides": [list(pose.sides) for pose in poses],
    }
    if any(base for _, base in visits.read[0]):
        block |= {"kind": "legs", "legs": [[list(leg) for leg in legs] for legs in visits.read]}
    else:
        block |= {"kind": "poses", "select": "list", "targets": list(targets)}
        if repeats > 1:
            block["readings"] = repeats
    table = {
        "format": "truepose-campaign/1",
        "seed": asked.seed,
        "approach": {"offset_deg": -asked.offset_deg, "sides": "both" if asked.both else "one"},
        "block": [block],
    }
    if nest_limit_mm is not None:
        table["nest_check"] = {"every": max(visits.readings // 2, 1), "limit_mm": round(nest_limit_mm, 4)}
    if robot.get("serial"):
        table["robot"] = {key: robot[key] for key in ("maker", "model", "serial") if robot.get(key)}
    return f"# Check poses of {model}, by truepose watch plan.\n{tomli_w.dumps(table)}"


def touched_files(
    out: Path, cell: Cell, asked: PlanQuestion, target: str, poses: Sequence[Pose], balls: Sequence[str]
) -> dict[Path, str]:
    """The data set of touches by path: a row a pose with the place of its ball, one of `balls`; whoever has touched it
    writes the joints that the controller shows, and empties the status. Raises DataError where `out` is no CSV file."""
    if out.suffix != ".csv":
        raise DataError(
            "is no data set: a touched artefact is written down, not driven.",
            do="Name a .csv file.",
            file=out,
            key="--out",
        )
    values = planned_header(cell)
    values["noise"] = {
        "kind": "isotropic",
        "sigma_mm": asked.touch_mm,
        "repeatability_deg": cell.robot.repeatability_deg,
    }
    values["instrument"], values["readings"] = "touch", f"1-{len(poses)}"
    for key in ("base_targets", "base_targets_u_mm", "nests", "u_mm_assumed", "model"):
        values.pop(key, None)
    robot, text = cell.robot.model, io.StringIO(newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(
        [
            *("reading_id", "ball", "status", "tool_target", "x_mm", "y_mm", "z_mm"),
            *robot.joint_columns,
            *robot.approach_columns,
            "t_air_c",
        ]
    )
    for i, (pose, name) in enumerate(zip(poses, balls, strict=True), start=1):
        rows.writerow([i, name, NOT_TOUCHED, target, *cell.nests[name], *pose.joints_deg, *pose.sides, ""])
    return {out: text.getvalue(), out.with_suffix(".toml"): tomli_w.dumps(values)}
