"""Result of an examination of a cell's devices, for `doctor --json` and for the service.

It includes the verdict in one line.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from acquisition.examination import Examination
from service import exit_codes
from service.results.shape import ResponseBody, told
from service.wording import counted


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
    """Result of an examination: the faults that prevent a campaign, if any."""

    format: Annotated[Literal["truepose-doctor/1"], told("The format.", "truepose-doctor/1")]
    cell: Annotated[str, told("The cell.", "irb120-cell")]
    simulated: Annotated[bool, told("Whether simulators were measured and no real devices.", False)]
    healthy: Annotated[bool, told("No fault.", True)]
    verdict: Annotated[
        str, told("The same in one line.", "irb120-cell: HEALTHY, 2 notes; 31 checks in 1.2 s.")
    ]
    exit_code: Annotated[int, told("That of the command: 0 healthy, 5 unsafe; no unit.", 0)]
    seconds: Annotated[float, told("Time it took, s.", 1.2)]
    findings: Annotated[list[FindingShown], told("Every check.", [])]

    @classmethod
    def of(cls, found: Examination) -> Self:
        """Describe the result of an examination."""
        return cls(
            format="truepose-doctor/1",
            cell=found.cell,
            simulated=found.simulated,
            healthy=not found.faults,
            verdict=_verdict(found),
            exit_code=found.exit_code,
            seconds=round(found.seconds, 3),
            findings=[FindingShown.model_validate(finding) for finding in found.findings],
        )


def _verdict(found: Examination) -> str:
    """State in one line whether a campaign can begin; otherwise list the faults that prevent it."""
    head = f"{found.cell}{' (SIMULATED)' if found.simulated else ''}: "
    checks = f"{counted(len(found.findings), 'check')} in {found.seconds:.1f} s"
    if not found.faults:
        return f"{head}HEALTHY, {counted(len(found.notes), 'note')}; {checks}."
    names = list(dict.fromkeys(f"{fault.device} {fault.check}" for fault in found.faults))
    word = "UNSAFE" if found.exit_code == exit_codes.REFUSED else "NOT READY"
    return f"{head}{word}, {counted(len(names), 'fault')}: {', '.join(names)}; {checks}."
