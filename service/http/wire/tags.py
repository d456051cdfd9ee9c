"""Tags of the interface: the core, the six steps of the operator's page, and the others.

Their order is that of `/docs` and of `tags` in `/openapi.json`.
"""

from __future__ import annotations

from enum import Enum


class Tag(Enum):
    """A group of operations. Those of the core also have the tag of their step."""

    CORE = "Core"
    CELL = "Cell"
    PREPARE = "Prepare"
    CHECK = "Check"
    MEASURE = "Measure"
    DIAGNOSE = "Diagnose"
    CORRECT = "Correct"
    VERIFY = "Verify"
    DATA = "Data and results"
    ROBOTS = "Robots"


TAGS = {
    Tag.CORE: "What a first client needs: take control, run or upload, answer prompts, diagnose, read the report; or "
    "all of it as a loop. docs/cell-pc/core.md has an example of each.",
    Tag.CELL: "The service, the cell, its devices, and the motion lease.",
    Tag.PREPARE: "Step 1: campaigns, poses and placements; the cell in 3D.",
    Tag.CHECK: "Step 2: the devices, and every pose and path of a plan; nothing moves.",
    Tag.MEASURE: "Step 3: runs and loops, their prompts, events and poses.",
    Tag.DIAGNOSE: "Step 4: what the model lacks; models, reports and errors in space.",
    Tag.CORRECT: "Step 5: corrected targets and programs, exports, the certificate.",
    Tag.VERIFY: "Step 6: the error at new poses, on the robot or on other readings.",
    Tag.DATA: "Data sets and files of other programs; what was deleted.",
    Tag.ROBOTS: "The history of robots, and whether one has changed.",
}
