"""Result document of a diagnosis (`truepose-diagnosis/1`), and the request that creates it.

Values are in the units of files and screens; null stands for NaN.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field

from acquisition.cell import Cell
from acquisition.loop import campaign_table, fits, in_cell
from calib.data import Dataset
from calib.diagnose import (
    MOST_EFFECTS,
    SEPARATES,
    CarriedTerm,
    CarryOver,
    DiagnosedEffect,
    DiagnosisFit,
    FollowUp,
    carry_over,
    diagnose,
)
from calib.fit import ErrorStatistics, silent
from calib.prior import TypePrior
from calib.regression import Patch, error_with_patch, error_without_patch, patch_of
from calib.text import written_by
from calib.units import DEG, to_display
from service import wording
from service.results.common import (
    ERRORS,
    Campaign,
    DataShown,
    ErrorStatisticsResponse,
    Figure,
    FitShown,
    Number,
    ParameterResponse,
    ReadingId,
    Share,
    Unit,
)
from service.results.judgement.acceptance import AcceptanceLimits, AcceptanceResult, decide, judged_as
from service.results.models.parameters import rows_of
from service.results.shape import Real, ResponseBody, document_of, told

Verdict = Literal["complete", "excess_noise", "attributed", "ambiguous", "unexplained"]
Label = Annotated[str, told("The label of an effect.", "backlash:j4")]


class Evidence(ResponseBody):
    """The evidence for an effect."""

    delta_bic: Number
    p_value: Annotated[Real, told("Probability that chance shows as much.", 1e-12)]
    explained_variance: Share


class EffectShown(ResponseBody):
    """An effect that was found, with the probability of each of its possible causes."""

    label: Label
    meaning: Annotated[str, told("What it means, for people.", "Joint 4 has play.")]
    index: Annotated[ReadingId | None, told("Of a step: the reading at which it is.", None)]
    candidates: Annotated[dict[str, Real], told("Probability by label.", {"backlash:j4": 1.0})]
    parameters: Annotated[
        dict[str, Figure], told("By name.", {"gap": {"value": 0.131, "std": 0.002, "unit": "deg"}})
    ]
    amplitude: Annotated[Figure, told("Its size.", {"value": 0.131, "std": 0.002, "unit": "deg"})]
    evidence: Annotated[Evidence, told("The evidence for it.", {"delta_bic": 605.4})]
    owner: Annotated[str, told("To whom it belongs: robot, mounting, tool, instrument ...", "robot")]
    group: Annotated[str, told("The family of effects.", "transmission")]
    check: Annotated[
        str,
        told(
            "What a technician checks; empty where the cause is not known or the size is usual.",
            "Check the preload of the gear of joint 4.",
        ),
    ]
    shape: Annotated[dict[str, Real], told("Figures of its shape, by name with unit.", {})]
    shape_std: Annotated[
        dict[str, Real], told("Standard errors of those that were scanned, by name with unit.", {})
    ] = Field(default_factory=dict)
    between: Annotated[
        list[ReadingId] | None,
        told(
            "Of a step: ids of the last reading before it and the first after it, no unit; 95 % probability.",
            None,
        ),
    ] = None
    usual_size: Annotated[Real, told("Usual size, in `unit` of the amplitude; null if not known.", 0.1)] = (
        None
    )
    confirmed: Annotated[bool, told("Whether the size exceeds its expanded uncertainty (k = 2).", True)] = (
        True
    )
    imitates: Annotated[
        bool, told("Whether the effect may only imitate a law that no effect explains.", False)
    ] = False
    impossible: Annotated[
        bool, told("Whether physics forbids the value, as of a negative compliance.", False)
    ] = False

    @classmethod
    def of(cls, found: DiagnosedEffect, *, causes_known: bool) -> Self:
        """Describe an effect that `calib` found."""
        effect, spread = found.effect, np.sqrt(np.diag(found.covariance))
        return cls(
            label=effect.label,
            meaning=effect.meaning,
            index=found.index,
            candidates=dict(found.evidence.candidates),
            parameters={
                p.short: Figure.of(to_display(float(v), p.unit), to_display(float(s), p.unit), p.unit)
                for p, v, s in zip(effect.parameters, found.values, spread, strict=True)
            },
            amplitude=Figure.of(*found.amplitude),
            evidence=Evidence.model_validate(found.evidence),
            owner=effect.owner,
            group=effect.group,
            check=wording.advice_on(found, causes_known=causes_known),
            shape=dict(effect.shape),
            shape_std=dict(found.shape_std),
            between=None if found.between is None else list(found.between),
            usual_size=found.usual,
            confirmed=bool(found.confirmed),
            imitates=not causes_known,
            impossible=bool(found.impossible),
        )


class Separation(ResponseBody):
    """Distance by which the next measurement distinguishes an effect from its rival."""

    effect: Label
    rival: Label
    squared_distance: Number


class FollowUpShown(ResponseBody):
    """The next measurement: poses, or a procedure for a person."""

    kind: Annotated[Literal["poses", "procedure"], told("Which of the two.", "poses")]
    text: Annotated[str, told("Of a procedure: what to do.", "Turn joint 5 through its whole range.")] = ""
    joints_deg: Annotated[list[list[float]], told("The poses, deg.", [])] = Field(default_factory=list)
    sides: Annotated[list[list[int]], told("The side of approach of each joint, +1 or -1; no unit.", [])] = (
        Field(default_factory=list)
    )
    approach_deg: Annotated[list[float], told("How far before the pose the last move begins, deg.", [])] = (
        Field(default_factory=list)
    )
    targets: Annotated[list[str], told("Names of targets.", ["T1"])] = Field(default_factory=list)
    separates: Annotated[list[Separation], told("The rivals that they tell apart.", [])] = Field(
        default_factory=list
    )
    settles: Annotated[
        float | None, told("Squared distance from which a rival counts as settled; no unit.", 30.0)
    ] = None
    campaign: Annotated[
        Campaign, told("The campaign that measures them.", {"format": "truepose-campaign/1"})
    ] = Field(default_factory=dict)

    @classmethod
    def poses_of(cls, found: FollowUp) -> Self:
        """Describe the poses of a follow-up measurement.

        Joints are in controller angles. In each pose, all joints arrive from the same side.
        """
        joints, robot = found.joints.shape[1], next(iter(found.rivals.values())).model.robot
        return cls(
            kind="poses",
            joints_deg=np.round(found.joints / robot.joint_units, 4).tolist(),
            sides=[[int(side)] * joints for side in found.sides],
            approach_deg=np.round(found.approach / DEG, 4).tolist(),
            targets=list(found.targets),
            separates=[
                Separation(effect=label, rival=rival, squared_distance=square)
                for (label, rival), square in found.separations.items()
            ],
            settles=SEPARATES,
            campaign=campaign_table(found),
        )

    @classmethod
    def all_of(cls, found: FollowUp | None) -> list[Self]:
        """Create one entry for the poses, and one per procedure."""
        if found is None:
            return []
        return [cls.poses_of(found), *(cls(kind="procedure", text=text) for text in found.procedures)]


class StructureShown(ResponseBody):
    """Structure that is left and that no effect of the library explains."""

    where: Annotated[str, told("What it goes with.", "j5")]
    acts_on: Annotated[str, told("On what it acts.", "the tool point")]
    p_value: Annotated[Real, told("Probability that chance shows as much.", 1e-6)]
    explained_variance: Share


class CarriedShown(ResponseBody):
    """A carried term: an error that left-out readings confirm and that has no known cause."""

    label: Label
    finding: Annotated[str, told("Where and how large, in a sentence.", "The offset d5 follows time.")]
    acts_on: Annotated[str, told("On what it acts.", "the offset d5")]
    slot: Annotated[str, told("The slot of the chain on which it acts.", "d5")]
    where: Annotated[str, told("What it follows, as places of structure are named.", "time")]
    between: Annotated[
        list[ReadingId] | None,
        told("Of a change: ids of the readings before and after it, no unit; 95 % confidence.", [189, 231]),
    ]
    amplitude: Annotated[Figure, told("Its size.", {"value": -0.13, "std": 0.01, "unit": "mm"})]
    explained_variance: Share
    p_value: Annotated[Real, told("Probability that chance shows as much.", 1e-9)]
    confirmed: Annotated[bool, told("Whether the size exceeds its expanded uncertainty (k = 2).", True)]
    usable: Annotated[bool, told("Whether what it follows is known when the model is used.", True)]

    @classmethod
    def of(cls, term: CarriedTerm) -> Self:
        """Describe a carried term that `calib` found."""
        return cls(
            label=term.effect.label,
            finding=wording.carried_in_words(term),
            acts_on=term.place,
            slot=term.slot,
            where=term.condition,
            between=None if term.between is None else list(term.between),
            amplitude=Figure.of(*term.effect.amplitude(term.values, term.covariance)),
            explained_variance=term.explained,
            p_value=term.p_value,
            confirmed=wording.exceeds(term),
            usable=bool(term.effect.is_usable),
        )


class SharesShown(ResponseBody):
    """Shares of the squared error that the base model leaves; they add up to 1."""

    named: Share
    carried: Share
    noise: Share


class Power(ResponseBody):
    """The smallest size of an effect that these readings would show."""

    label: Label
    smallest: Annotated[Real, told("That size, in `unit`.", 0.0037, of="size")]
    unit: Unit


class CarriedOver(ResponseBody):
    """The effects judged on another data set."""

    data: Annotated[str, told("Its name.", "B.csv", of="name")]
    error_base_mm: Annotated[
        ErrorStatisticsResponse | None, told("Its own base model, mm.", ERRORS, of="base")
    ]
    error_frozen_mm: Annotated[
        ErrorStatisticsResponse | None, told("With the effects as found, mm.", ERRORS, of="frozen")
    ]
    error_refitted_mm: Annotated[
        ErrorStatisticsResponse | None, told("With amplitudes refitted, mm.", ERRORS, of="refitted")
    ]
    finding: Annotated[str, told("In words.", "The effects carry over.")]


class PatchResponse(ResponseBody):
    """A smooth map of the error that the model leaves; it is never part of the model."""

    meaning: Annotated[str, told("What it is.", "A smooth map; a patch, not a cause.")]
    block_rms_without_mm: Annotated[Real, told("Error on left-out blocks without it, RMS, mm.", 0.12)]
    block_rms_with_mm: Annotated[Real, told("The same with it, mm.", 0.08)]
    worth_it: Annotated[bool, told("Whether left-out blocks gain by it.", True)]
    width: Annotated[float, told("Width of its kernel, a ratio to the spread of the joints.", 0.5)]
    ridge: Annotated[float, told("Its ridge; no unit.", 0.1)]
    landmarks: Annotated[int, told("Number of poses on which it stands.", 60)]
    error_without_mm: Annotated[
        ErrorStatisticsResponse | None, told("Without it, on readings held out, mm.", ERRORS)
    ]
    error_with_mm: Annotated[
        ErrorStatisticsResponse | None, told("With it, on readings held out, mm.", ERRORS)
    ]

    @classmethod
    def of(cls, found: PatchResult) -> Self:
        """Describe a patch with its errors."""
        patch = found.patch
        return cls.model_validate(
            {
                "meaning": "A smooth map of what no named effect explains; a patch, not a cause.",
                "block_rms_without_mm": patch.block_rms_without,
                "block_rms_with_mm": patch.block_rms_with,
                "worth_it": bool(patch.worth_it),
                "width": patch.width,
                "ridge": patch.ridge,
                "landmarks": len(patch.landmarks),
                "error_without_mm": found.without,
                "error_with_mm": found.with_it,
            }
        )


class HeldOutMisfit(ResponseBody):
    """The error of held-out readings compared with its expectation.

    The expectation follows from the noise and the uncertainty of the parameters.
    """

    times_expected: Annotated[
        Real,
        told("Their whitened RMS over the one expected, a ratio; 1 as expected.", 1.02, of="times"),
    ]
    p_value: Annotated[Real, told("Probability that chance leaves as much (chi-squared).", 0.31)]
    beyond: Annotated[
        bool, told("Whether the model does not hold there: told before the verdict.", False, of="real")
    ]


class HeldOutFaultShown(ResponseBody):
    """A held-out reading with a gross error or of another tool target than stated."""

    reading_id: Annotated[str, told("The reading.", "212")]
    target: Annotated[str, told("Its tool target as the data set has it.", "A")]
    fits: Annotated[str | None, told("The tool target that it fits; null for a gross error.", "B")]
    error_mm: Annotated[Real, told("Its distance from the prediction, mm.", 41.2)]


class DiagnosisResult(FitShown):
    """A diagnosis (`truepose-diagnosis/1`)."""

    format: Annotated[Literal["truepose-diagnosis/1"], told("The format.", "truepose-diagnosis/1")]
    program: Annotated[str, told("The program and its version.", "truepose 0.1.0")]
    simulated: Annotated[bool, told("Whether simulators were measured.", False)]
    verdict: Annotated[
        Verdict,
        told(
            "complete: nothing is missing; attributed: what was missing has names; ambiguous: several names fit; "
            "unexplained: structure is left; excess_noise: more noise than declared.",
            "attributed",
        ),
    ]
    finding: Annotated[
        str, told("The verdict in sentences.", "Found 1 effect that the base model lacks: play of joint 4.")
    ] = ""
    effects: Annotated[list[EffectShown], told("What was found, the largest first.", [])]
    p_lack_of_fit: Annotated[Real, told("Probability that chance leaves as much.", 0.58)]
    error_before_mm: Annotated[
        ErrorStatisticsResponse | None, told("Of the base model, on readings held out, mm.", ERRORS)
    ]
    error_named_mm: Annotated[
        ErrorStatisticsResponse | None, told("With the named effects only, on readings held out, mm.", ERRORS)
    ] = None
    error_after_mm: Annotated[
        ErrorStatisticsResponse | None,
        told("With effects and carried terms, on readings held out, mm.", ERRORS),
    ]
    raises_held_out_error: Annotated[list[str], told("Labels of effects that do.", [])]
    held_out_misfit: Annotated[
        HeldOutMisfit | None,
        told(
            "Readings held out against their expectation; null where there were none.",
            {"times_expected": 1.02, "p_value": 0.31, "beyond": False},
        ),
    ] = None
    held_out_faults: Annotated[
        list[HeldOutFaultShown],
        told("Held-out readings of another tool target, or with a gross error.", []),
        Field(default_factory=list),
    ]
    error_without_faults_mm: Annotated[
        ErrorStatisticsResponse | None,
        told("Error of the held-out readings without these, mm; null if none is left.", None),
    ] = None
    follow_up: Annotated[list[FollowUpShown], told("What to measure next where something is ambiguous.", [])]
    shares: Annotated[
        SharesShown | None,
        told(
            "How much has a named cause, is carried without one, and is noise.",
            {"named": 0.8, "carried": 0.1, "noise": 0.1},
        ),
    ] = None
    carried: Annotated[list[CarriedShown], told("Terms without a known cause.", [])] = Field(
        default_factory=list
    )
    withdrawn: Annotated[
        list[str], told("Labels of effects found first that did not hold beside carried terms.", [])
    ] = Field(default_factory=list)
    brought_back: Annotated[
        list[ReadingId],
        told("Ids (no unit) of readings left out that came back, since they lie together.", []),
    ] = Field(default_factory=list)
    held_out_agrees: Annotated[
        bool | None,
        told(
            "Whether held-out readings agree with the model, carried terms included; null without any.", True
        ),
    ] = None
    next_measurements: Annotated[
        list[str],
        told("What to measure next where a cause is not known.", ["Move joint 3 alone through its range."]),
    ] = Field(default_factory=list)
    structure: Annotated[list[StructureShown], told("What is left.", [])]
    parameters: Annotated[list[ParameterResponse], told("Every parameter of the base model.", [])] = Field(
        default_factory=list
    )
    power: Annotated[list[Power], told("What would have been seen.", [])]
    notes: Annotated[list[str], told("What else is to be known.", [])]
    carry_over: Annotated[CarriedOver | None, told("Where another data set was judged.", None)] = None
    patch: Annotated[PatchResponse | None, told("The map of what is left, where it was asked for.", None)] = (
        None
    )
    seconds: Annotated[float, told("Time it took, s.", 3.4)]

    @classmethod
    def of(cls, outcome: DiagnosisOutcome, **more: Any) -> Self:
        """Build the result of a diagnosis; `more` adds members at its end."""
        found, faults = outcome.diagnosis, outcome.diagnosis.held_out_faults
        asked = {
            "carry_over": outcome.carried,
            "patch": None if outcome.patched is None else PatchResponse.of(outcome.patched),
            "seconds": round(found.seconds, 3),
            "acceptance": outcome.acceptance,
        }
        return cls.model_validate(
            {
                "format": "truepose-diagnosis/1",
                "program": written_by(),
                "simulated": found.dataset.header.simulated,
                "verdict": found.verdict,
                "finding": wording.verdict_in_words(found),
                "effects": [EffectShown.of(each, causes_known=found.causes_known) for each in found.effects],
                **cls.fit_members(found.dataset, found.final),
                "p_lack_of_fit": found.p_lack_of_fit,
                "error_before_mm": found.error_before,
                "error_named_mm": found.error_named,
                "error_after_mm": found.error_after,
                "error_nominal_mm": found.error_nominal,
                "raises_held_out_error": found.harmful,
                "held_out_misfit": found.surprise,
                "held_out_faults": faults.faults,
                "error_without_faults_mm": faults.error_without,
                "holdout": found.dataset.header.holdout,
                "follow_up": FollowUpShown.all_of(found.follow_up),
                "shares": found.shares,
                "carried": [CarriedShown.of(term) for term in found.carried],
                "withdrawn": found.withdrawn,
                "brought_back": found.back,
                "held_out_agrees": found.agrees,
                "next_measurements": found.next_measurements,
                "structure": found.structure,
                "power": found.power,
                "notes": found.notes,
                "parameters": rows_of(found.final, base_model_only=True),
                "data": DataShown.of(found.dataset),
                **{name: value for name, value in asked.items() if value is not None},
                **more,
            }
        )


@dataclass(frozen=True)
class PatchResult:
    """A patch with its errors on held-out readings; never part of the model, never an effect."""

    patch: Patch
    without: ErrorStatistics | None
    with_it: ErrorStatistics | None

    @classmethod
    def of(cls, diagnosis: DiagnosisFit) -> PatchResult:
        """Fit a patch to the error that a diagnosis leaves."""
        dataset, final = diagnosis.dataset, diagnosis.final
        patch = patch_of(dataset, final)
        return cls(patch, error_without_patch(dataset, final), error_with_patch(dataset, final, patch))


@dataclass(frozen=True)
class DiagnosisRequest:
    """The options of a diagnosis.

    Attributes
    ----------
    most : int
        Number of effects that may be added.
    prior : TypePrior or None
        Prior learned from robots of the same type.
    carry_to : Dataset or None
        Another data set of the robot, on which the effects are judged as well.
    patch : bool
        Whether to map the error that remains.
    cell : Cell or None
        Cell within which the proposed next measurements must lie.
    any_cell : bool
        Whether to ignore a cell whose robot or targets are not those of the data, instead of refusing it.
    limits : AcceptanceLimits or None
        Limits of the error on held-out readings.
    """

    most: int = MOST_EFFECTS
    prior: TypePrior | None = None
    carry_to: Dataset | None = None
    patch: bool = False
    cell: Cell | None = None
    any_cell: bool = False
    limits: AcceptanceLimits | None = None


@dataclass(frozen=True)
class DiagnosisOutcome:
    """A diagnosis with its optional results.

    These are the effects judged on another data set, the patch and the acceptance; None if not requested.
    """

    diagnosis: DiagnosisFit
    carried: CarryOver | None = None
    patched: PatchResult | None = None
    acceptance: AcceptanceResult | None = None

    @staticmethod
    def of(
        dataset: Dataset, asked: DiagnosisRequest, say: Callable[[str], None] = silent
    ) -> DiagnosisOutcome:
        """Diagnose a data set.

        Parameters
        ----------
        say : callable, optional
            Called with the name of each step.

        Raises
        ------
        DataError
            The data set cannot be diagnosed, or it does not match the cell, the limits or the other data set.
        ConfigError
            Hardly any pose of the cell is clear.
        """
        if asked.limits is not None:
            asked.limits.refuse_unjudged(dataset)
        found = diagnose(dataset, most=asked.most, prior=asked.prior, progress=say)
        cell = asked.cell
        if (
            cell is not None
            and found.follow_up is not None
            and (not asked.any_cell or fits(cell, found.final))
        ):
            say("seeking poses of the cell that distinguish rivals")
            found = replace(found, follow_up=in_cell(cell, found.final, found.follow_up.rivals))
        carried = patched = acceptance = None
        if asked.carry_to is not None:
            say("judging the effects on the other data set")
            carried = carry_over(found, asked.carry_to)
        if asked.patch:
            say("mapping what is left")
            patched = PatchResult.of(found)
        if asked.limits is not None:
            final = (found.final.model, found.final.estimate)
            acceptance = decide(
                asked.limits, dataset, dataset.validation_rows, *final, judged_as(found.effects)
            )
        return DiagnosisOutcome(found, carried, patched, acceptance)

    def document(self) -> dict[str, Any]:
        """Build the document of the result (`truepose-diagnosis/1`)."""
        return document_of(DiagnosisResult.of(self))
