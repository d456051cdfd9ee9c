"""Verification section: errors of the real robot with corrected targets, and predictions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from acquisition.record import Verification
from calib.diagnose import DiagnosisFit
from calib.fit import ErrorStatistics
from service import wording

NEARLY = 1.3  # times the floor: limit of a correction


def rows_of(diagnosis: DiagnosisFit, verification: Verification) -> dict[str, ErrorStatistics | None]:
    """Return the errors of each model on validation readings (predicted), then of the robot."""
    return {
        "nominal robot, placed (predicted)": diagnosis.error_nominal,
        "level 3 (predicted)": diagnosis.error_before,
        "with the effects found (predicted)": diagnosis.error_after,
        "driven uncorrected (on the robot)": verification.uncorrected,
        "driven corrected: verified on the robot": verification.verified,
    }


def floor_in_words(verification: Verification) -> str:
    """Return the verified error compared with what noise and repeatability allow."""
    return (
        f"A perfect correction would show {verification.floor_mm:.3f} mm RMS here, from the instrument's noise and "
        f"the robot's repeatability; the robot shows {verification.ratio:.2f} times that."
    )


def scope_in_words(verification: Verification) -> str:
    """Return the scope of the values as text."""
    what = "position errors against where the nominal robot would put the targets"
    if verification.of_lengths:
        what = (
            "errors of lengths along the ballbar, not of positions, against the lengths that the nominal robot would "
            "hold; no pose was driven uncorrected"
        )
    text = (
        f"{wording.counted(verification.poses, 'new pose')}, {wording.counted(verification.verified.n, 'reading')}; "
        f"approach {verification.approach}; {what}"
    )
    if verification.refused:
        count = len(verification.refused)
        text += f"; {count} other{'s were' if count > 1 else ' was'} refused: {verification.refused[0]}"
    return "; ".join((text, *verification.accepted)) + "."


def section_of(verification: Verification | None) -> Mapping[str, Any] | None:
    """Build the section of the template; None if nothing was driven.

    The predictions of models are only in the ladder.
    """
    if verification is None:
        return None
    driven = {"Driven uncorrected": verification.uncorrected, "Driven corrected": verification.verified}
    return {
        "rows": [(name, e) for name, e in driven.items() if e is not None],
        "floor": floor_in_words(verification),
        "scope": scope_in_words(verification),
        "reached": verification.ratio <= NEARLY,
    }
