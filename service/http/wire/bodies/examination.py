"""The body of an examination of the cell's devices (`truepose-doctor/1`)."""

from __future__ import annotations

from typing import Annotated, Literal

from service.http.wire.bodies.fields import ResponseBody, Simulated, told


class FindingShown(ResponseBody):
    """One check."""

    device: Annotated[str, told("robot, instrument or computer.", "robot")]
    check: Annotated[str, told("A stable name of the check.", "limits")]
    level: Annotated[
        Literal["ok", "note", "fault"], told("`fault`: a campaign would be refused or not trusted.", "ok")
    ]
    found: Annotated[str, told("What was found.", "as in the cell file")]
    do: Annotated[str, told("What to do.", "")]
    code: Annotated[int | None, told("Number of the kind of error; no unit.", None)]
    error: Annotated[str | None, told("The kind of error.", None)]


class ExaminationShown(ResponseBody):
    """Whether a campaign can begin, and else what prevents it."""

    format: Annotated[Literal["truepose-doctor/1"], told("The format.", "truepose-doctor/1")]
    cell: Annotated[str, told("The cell.", "irb120-cell")]
    simulated: Simulated
    healthy: Annotated[bool, told("No fault.", True)]
    verdict: Annotated[
        str, told("The same in one line.", "irb120-cell: HEALTHY, 2 notes; 31 checks in 1.2 s.")
    ]
    exit_code: Annotated[int, told("That of the command: 0 healthy, 5 unsafe; no unit.", 0)]
    seconds: Annotated[float, told("Time it took, s.", 1.2)]
    findings: Annotated[list[FindingShown], told("Every check.", [])]
