"""Terminal display of a closed loop's results."""

from __future__ import annotations

from acquisition.loop import LoopResult
from service import wording
from service.printed import tables
from service.printed.terminal import Terminal


def show_loop(result: LoopResult, terminal: Terminal) -> None:
    """Print verdict, causes, and errors before and after on the robot."""
    from service.report.sections import verification  # drawing takes long to import
    from service.report.sections.follow_up_section import middle_step_in_words

    diagnosis, verified = result.diagnosis, result.verification
    if result.accuracy is not None:
        terminal.out.print(result.accuracy["ended"])
    if result.followed_up is not None:
        terminal.out.print(middle_step_in_words(result.followed_up, diagnosis))
    terminal.out.print(f"{wording.VERDICT_NAMES[diagnosis.verdict]}. {wording.verdict_in_words(diagnosis)}")
    terminal.out.print(tables.effects(diagnosis))
    for found in diagnosis.confirmed if diagnosis.causes_known else ():
        terminal.out.print(f"Your model lacked: {wording.sentence_of(found)}")
    data = diagnosis.dataset
    holdout = data.header.holdout if data.validation_rows.any() else "new poses on the robot, after the fit"
    kind = wording.error_kind(data)
    terminal.out.print(tables.errors(verification.rows_of(diagnosis, verified), holdout, kind))
    terminal.out.print(f"On the robot: {verification.scope_in_words(verified)}")
    terminal.out.print(verification.floor_in_words(verified))
