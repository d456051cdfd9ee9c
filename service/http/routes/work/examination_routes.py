"""The examination of the cell's devices, as in `truepose doctor`.

It is read-only: nothing is armed, moved or set.
"""

from __future__ import annotations

from fastapi import APIRouter

from acquisition.examination import examine
from service.http.routes.json_route import JsonRoute
from service.http.state import Here
from service.http.wire.tags import Tag
from service.results.cell.examined import ExaminationShown

router = APIRouter(route_class=JsonRoute, tags=[Tag.CHECK])


@router.post("/cell/examination", operation_id="examineCell")
def examine_cell(here: Here) -> ExaminationShown:
    """Ask every device whether a campaign can begin. Needs no lease; 409 while the robot is used."""
    cell = here.cell
    with here.book.examined() as note:
        found = examine(
            cell,
            here.devices(cell),
            record=here.settings.record,
            simulated=here.settings.simulated is not None,
        )
        note(found)
    return ExaminationShown.of(found)
