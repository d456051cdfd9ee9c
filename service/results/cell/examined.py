"""The document of an examination of a cell's devices, and its verdict in one line."""

from __future__ import annotations

from typing import Any

from acquisition.examination import Examination
from service import exit_codes
from service.wording import counted

FORMAT = "truepose-doctor/1"


def document_of(found: Examination) -> dict[str, Any]:
    """Document of an examination, as `doctor --json` and the service have it."""
    return {
        "format": FORMAT,
        "cell": found.cell,
        "simulated": found.simulated,
        "healthy": not found.faults,
        "verdict": verdict_of(found),
        "exit_code": found.exit_code,
        "seconds": round(found.seconds, 3),
        "findings": [finding.as_dict() for finding in found.findings],
    }


def verdict_of(found: Examination) -> str:
    """One line: whether a campaign can begin, and else what prevents it."""
    head = f"{found.cell}{' (SIMULATED)' if found.simulated else ''}: "
    checks = f"{counted(len(found.findings), 'check')} in {found.seconds:.1f} s"
    if not found.faults:
        return f"{head}HEALTHY, {counted(len(found.notes), 'note')}; {checks}."
    names = list(dict.fromkeys(f"{fault.device} {fault.check}" for fault in found.faults))
    word = "UNSAFE" if found.exit_code == exit_codes.REFUSED else "NOT READY"
    return f"{head}{word}, {counted(len(names), 'fault')}: {', '.join(names)}; {checks}."
