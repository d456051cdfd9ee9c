"""A job of the service in its own process. This would catch: follow-up poses that the service's cell cannot take."""

from __future__ import annotations

import json
from pathlib import Path

from acquisition import campaign_from, checked_plan, read_cell
from service.job import do
from service.job_folder import JOB, RESULT
from tests.end_to_end.simulated import EXAMPLE
from tests.service.campaigns import write_narrow_data


def result_of(folder: Path, data: Path, cell: str) -> dict[str, object]:
    folder.mkdir()
    job = {"kind": "diagnosis", "data": str(data), "simulated": True, "cell": cell}
    (folder / JOB).write_text(json.dumps(job), encoding="utf-8")
    do(folder)
    return json.loads((folder / RESULT).read_text("utf-8"))


def test_what_is_ambiguous_becomes_a_campaign_for_the_cell_of_the_service(tmp_path: Path) -> None:
    cell = read_cell(EXAMPLE / "cell.toml")
    data = write_narrow_data(tmp_path)
    (poses, *_) = result_of(tmp_path / "job", data, cell.source)["follow_up"]  # type: ignore[misc]
    visits = checked_plan(cell, campaign_from(poses["campaign"], "follow-up"))
    assert sum(visit.kind == "pose" for visit in visits) == 12
    assert result_of(tmp_path / "other", data, cell.source.replace("T1 =", "A1 ="))["follow_up"]
