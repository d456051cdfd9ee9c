"""Results of a closed loop: result, model, corrected targets and report, in one folder.

result.json  model.json  targets.csv  report.html, next to data.csv and data.toml of the loop
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import Field

from acquisition.loop import FollowUpResult, LoopResult, targets_csv
from calib.saved import save_model
from calib.text import replace_file
from service.files import as_json
from service.job_folder import ARROWS, MODEL, REPORT, RESULT
from service.results.cell.accuracy import AccuracyShown
from service.results.cell.arrows import ArrowsShown
from service.results.common import ERRORS, ErrorStatisticsResponse
from service.results.models.diagnosed import (
    DiagnosisOutcome,
    DiagnosisResult,
    FollowUpShown,
    Label,
    Separation,
    Verdict,
)
from service.results.shape import Real, ResponseBody, document_of, told

if TYPE_CHECKING:
    from service.report.certificate import CertificateParties

TARGETS = "targets.csv"
FILES = (RESULT, MODEL, TARGETS, REPORT, ARROWS)


class LandingShown(ResponseBody):
    """One reading at a new pose."""

    pose: Annotated[int, told("Number of the pose, from 1.", 1)]
    target: Annotated[str, told("The target that was measured.", "T1")]
    corrected: Annotated[bool, told("Driven with the correction.", True)]
    joints_deg: Annotated[
        list[float],
        told(
            "Joints of the pose, not corrected, deg, or mm of joints that slide.",
            [12.0, 45.0, -10.0, 80.0, -35.0, 10.0],
        ),
    ]
    wanted_mm: Annotated[
        list[float], told("Where the target must be in the world, x, y, z, mm.", [401.2, 88.1, 310.4])
    ]
    error_mm: Annotated[list[float], told("Measured minus wanted, x, y, z, mm.", [0.021, -0.012, 0.004])]
    off_mm: Annotated[float, told("Length of that, mm.", 0.025)]
    u_mm: Annotated[
        float,
        told(
            "Expanded uncertainty (k = 2) of the error in its most uncertain direction, mm: noise of the instrument "
            "and repeatability of the robot, without that of the world frame.",
            0.06,
        ),
    ]


class Verified(ResponseBody):
    """The error of the robot at new poses when driven with corrected targets."""

    error_uncorrected_mm: Annotated[
        ErrorStatisticsResponse | None, told("Driven uncorrected, mm.", ERRORS, of="uncorrected")
    ]
    error_verified_mm: Annotated[
        ErrorStatisticsResponse, told("Driven corrected, mm.", ERRORS, of="verified")
    ]
    floor_rms_mm: Annotated[
        float, told("What noise and repeatability alone would show, mm.", 0.039, of="floor_mm")
    ]
    ratio: Annotated[float, told("Verified over floor, a ratio.", 1.07)]
    poses: Annotated[int, told("Number of new poses.", 20)]
    refused: Annotated[list[str], told("Targets that could not be corrected.", [])]
    nests_off_mm: Annotated[
        float | None, told("By how much the nests had moved, mm; null for a ballbar.", 0.01)
    ]
    approach: Annotated[str, told("The side of approach.", "from below")]
    accepted: Annotated[list[str], told("Other devices that were accepted.", [])]
    of_lengths: Annotated[
        bool, told("The errors are those of lengths along a ballbar, not of positions.", False)
    ] = False
    landings: Annotated[list[LandingShown], told("Every reading, in the order of measurement.", [])] = Field(
        default_factory=list
    )


class RivalsBefore(ResponseBody):
    """An effect that was ambiguous."""

    label: Label
    candidates: Annotated[dict[str, Real], told("Probability by label.", {"periodic:j5:n2": 0.7})]


class FollowUpResponse(ResponseBody):
    """The middle step of a loop, in which poses are measured to settle an ambiguous diagnosis."""

    verdict_before: Annotated[Verdict, told("The verdict before.", "ambiguous")]
    effects_before: Annotated[list[RivalsBefore], told("What was ambiguous.", [{"label": "periodic:j5:n2"}])]
    error_before_follow_up_mm: Annotated[
        ErrorStatisticsResponse | None, told("The error before, mm.", ERRORS)
    ]
    poses: Annotated[int, told("Number of poses that were added.", 12)]
    readings: Annotated[int, told("Number of readings that were added.", 36)]
    separates: Annotated[list[Separation], told("The rivals that they tell apart.", [])]

    @classmethod
    def of(cls, step: FollowUpResult) -> Self:
        """Describe the middle step of a loop."""
        before = step.before
        return cls.model_validate(
            {
                "verdict_before": before.verdict,
                "effects_before": [
                    {"label": found.effect.label, "candidates": found.evidence.candidates}
                    for found in before.effects
                ],
                "error_before_follow_up_mm": before.error_after,
                "poses": len(step.poses.joints),
                "readings": step.readings,
                "separates": FollowUpShown.poses_of(step.poses).separates,
            }
        )


class LoopResponse(DiagnosisResult):
    """A diagnosis with its verification on the robot."""

    verification: Annotated[Verified, told("Where the robot landed.", {"ratio": 1.07})]
    followed_up: Annotated[FollowUpResponse | None, told("Where poses were added.", None)] = None
    accuracy: Annotated[
        AccuracyShown | None, told("What the poses promised, where they were chosen while measuring.", None)
    ] = None


def write(
    result: LoopResult, folder: Path, *, name: str = RESULT, parties: CertificateParties | None = None
) -> tuple[dict[str, Any], str | None]:
    """Write the results of a loop; return the document of the result, and the hash of the model if there is one.

    `parties` fill in the first page of the report.

    The result is written last, as `name`: if it exists, all other files do too.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    from service.report import diagnosis_report  # drawing takes long to import

    step = result.followed_up
    followed = {} if step is None else {"followed_up": FollowUpResponse.of(step)}
    outcome = DiagnosisOutcome(result.diagnosis)
    reached = {} if result.accuracy is None else {"accuracy": result.accuracy}
    document = document_of(LoopResponse.of(outcome, verification=result.verification, **followed, **reached))
    final, sealed = result.diagnosis.final, None
    if final.converged:
        sealed = save_model(folder / MODEL, final, result.diagnosis, verified=result.verification.verified)
    replace_file(folder / TARGETS, targets_csv(result.targets, result.diagnosis.dataset.header.robot))
    replace_file(
        folder / REPORT,
        diagnosis_report(
            result.diagnosis,
            document,
            verified=result.verification,
            followed_up=result.followed_up,
            model_sha256=sealed,
            parties=parties,
        ),
    )
    replace_file(folder / ARROWS, as_json(document_of(ArrowsShown.of(result.diagnosis.dataset, final))))
    replace_file(folder / name, as_json(document))
    return document, sealed
