"""The bodies of diagnoses and closed loops, as `--json` of the command line has them.

`service.results` makes them; a test compares.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from service.http.wire.bodies.campaign import Campaign
from service.http.wire.bodies.fields import ResponseBody, told
from service.results.common import (
    ERRORS,
    ErrorStatisticsResponse,
    Figure,
    FitShown,
    Number,
    ParameterResponse,
    Share,
    Unit,
)

Verdict = Literal["complete", "excess_noise", "attributed", "ambiguous", "unexplained"]
Label = Annotated[str, told("The label of an effect.", "backlash:j4")]


class Evidence(ResponseBody):
    """The evidence for an effect."""

    delta_bic: Number
    p_value: Annotated[float | None, told("Probability that chance shows as much.", 1e-12)]
    explained_variance: Share


class EffectShown(ResponseBody):
    """An effect that was found. `candidates`: what else it may be, with odds."""

    label: Label
    meaning: Annotated[str, told("What it means, for people.", "Joint 4 has play.")]
    index: Annotated[int | str | None, told("Of a step: the reading at which it is.", None)]
    candidates: Annotated[dict[str, float | None], told("Probability by label.", {"backlash:j4": 1.0})]
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
    shape: Annotated[dict[str, float | None], told("Figures of its shape, by name with unit.", {})]
    shape_std: Annotated[
        dict[str, float | None], told("Standard errors of those that were scanned, by name with unit.", {})
    ] = Field(default_factory=dict)
    between: Annotated[
        list[int | str] | None,
        told(
            "Of a step: ids of the last reading before it and the first after it, no unit; 95 % probability.",
            None,
        ),
    ] = None
    usual_size: Annotated[
        float | None, told("Usual size, in `unit` of the amplitude; null if not known.", 0.1)
    ] = None
    confirmed: Annotated[bool, told("Whether the size exceeds its expanded uncertainty (k = 2).", True)] = (
        True
    )
    imitates: Annotated[
        bool, told("Whether the effect may only imitate a law that no effect explains.", False)
    ] = False
    impossible: Annotated[
        bool, told("Whether physics forbids the value, as of a negative compliance.", False)
    ] = False


class Separation(ResponseBody):
    """How well two rivals can be distinguished."""

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


class StructureShown(ResponseBody):
    """Structure that is left and that no effect of the library explains."""

    where: Annotated[str, told("What it goes with.", "j5")]
    acts_on: Annotated[str, told("On what it acts.", "the tool point")]
    p_value: Annotated[float | None, told("Probability that chance shows as much.", 1e-6)]
    explained_variance: Share


class CarriedShown(ResponseBody):
    """A carried term: an error that left-out readings confirm and that has no known cause."""

    label: Label
    finding: Annotated[str, told("Where and how large, in a sentence.", "The offset d5 follows time.")]
    acts_on: Annotated[str, told("On what it acts.", "the offset d5")]
    slot: Annotated[str, told("The slot of the chain on which it acts.", "d5")]
    where: Annotated[str, told("What it follows, as places of structure are named.", "time")]
    between: Annotated[
        list[int | str] | None,
        told("Of a change: ids of the readings before and after it, no unit; 95 % confidence.", [189, 231]),
    ]
    amplitude: Annotated[Figure, told("Its size.", {"value": -0.13, "std": 0.01, "unit": "mm"})]
    explained_variance: Share
    p_value: Annotated[float | None, told("Probability that chance shows as much.", 1e-9)]
    confirmed: Annotated[bool, told("Whether the size exceeds its expanded uncertainty (k = 2).", True)]
    usable: Annotated[bool, told("Whether what it follows is known when the model is used.", True)]


class SharesShown(ResponseBody):
    """Shares of the squared error that the base model leaves; they add up to 1."""

    named: Share
    carried: Share
    noise: Share


class Power(ResponseBody):
    """The smallest size of an effect that these readings would show."""

    label: Label
    smallest: Annotated[float | None, told("That size, in `unit`.", 0.0037)]
    unit: Unit


class CarriedOver(ResponseBody):
    """The effects judged on another data set."""

    data: Annotated[str, told("Its name.", "B.csv")]
    error_base_mm: Annotated[ErrorStatisticsResponse | None, told("Its own base model, mm.", ERRORS)]
    error_frozen_mm: Annotated[ErrorStatisticsResponse | None, told("With the effects as found, mm.", ERRORS)]
    error_refitted_mm: Annotated[
        ErrorStatisticsResponse | None, told("With amplitudes refitted, mm.", ERRORS)
    ]
    finding: Annotated[str, told("In words.", "The effects carry over.")]


class PatchResponse(ResponseBody):
    """A smooth map of what the model leaves, judged apart; never part of the model."""

    meaning: Annotated[str, told("What it is.", "A smooth map; a patch, not a cause.")]
    block_rms_without_mm: Annotated[float | None, told("Error on left-out blocks without it, RMS, mm.", 0.12)]
    block_rms_with_mm: Annotated[float | None, told("The same with it, mm.", 0.08)]
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


class HeldOutMisfit(ResponseBody):
    """The error of held-out readings beside what noise and the uncertainty of the parameters let expect."""

    times_expected: Annotated[
        float | None, told("Their whitened RMS over the one expected, a ratio; 1 as expected.", 1.02)
    ]
    p_value: Annotated[float | None, told("Probability that chance leaves as much (chi-squared).", 0.31)]
    beyond: Annotated[bool, told("Whether the model does not hold there: told before the verdict.", False)]


class HeldOutFaultShown(ResponseBody):
    """A held-out reading that is no reading of what it says."""

    reading_id: Annotated[str, told("The reading.", "212")]
    target: Annotated[str, told("Its tool target as the data set has it.", "A")]
    fits: Annotated[str | None, told("The tool target that it fits; null for a gross error.", "B")]
    error_mm: Annotated[float | None, told("Its distance from the prediction, mm.", 41.2)]


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
    p_lack_of_fit: Annotated[float | None, told("Probability that chance leaves as much.", 0.58)]
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
        list[int | str],
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


class Verified(ResponseBody):
    """Where the robot landed with corrected targets."""

    error_uncorrected_mm: Annotated[ErrorStatisticsResponse | None, told("Driven uncorrected, mm.", ERRORS)]
    error_verified_mm: Annotated[ErrorStatisticsResponse, told("Driven corrected, mm.", ERRORS)]
    floor_rms_mm: Annotated[float, told("What noise and repeatability alone would show, mm.", 0.039)]
    ratio: Annotated[float, told("Verified over floor, a ratio.", 1.07)]
    poses: Annotated[int, told("Number of new poses.", 20)]
    refused: Annotated[list[str], told("Targets that could not be corrected.", [])]
    nests_off_mm: Annotated[float | None, told("By how much the nests had moved, mm.", 0.01)]
    approach: Annotated[str, told("The side of approach.", "from below")]
    accepted: Annotated[list[str], told("Other devices that were accepted.", [])]


class RivalsBefore(ResponseBody):
    """An effect that was ambiguous."""

    label: Label
    candidates: Annotated[dict[str, float | None], told("Probability by label.", {"periodic:j5:n2": 0.7})]


class FollowUpResponse(ResponseBody):
    """The middle step of a loop: what was ambiguous, and what was measured to settle it."""

    verdict_before: Annotated[Verdict, told("The verdict before.", "ambiguous")]
    effects_before: Annotated[list[RivalsBefore], told("What was ambiguous.", [{"label": "periodic:j5:n2"}])]
    error_before_follow_up_mm: Annotated[
        ErrorStatisticsResponse | None, told("The error before, mm.", ERRORS)
    ]
    poses: Annotated[int, told("Number of poses that were added.", 12)]
    readings: Annotated[int, told("Number of readings that were added.", 36)]
    separates: Annotated[list[Separation], told("The rivals that they tell apart.", [])]


class LoopResponse(DiagnosisResult):
    """A diagnosis with its verification on the robot."""

    verification: Annotated[Verified, told("Where the robot landed.", {"ratio": 1.07})]
    followed_up: Annotated[FollowUpResponse | None, told("Where poses were added.", None)] = None
