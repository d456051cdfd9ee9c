"""The bodies of validations: what is asked, and the result (`truepose-validation/1`)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from service.http.wire.bodies.fields import ResponseBody, told
from service.http.wire.bodies.requests import JudgeRequest
from service.http.wire.bodies.results import AcceptanceShown, DataShown, Number, Unit

_MODEL_ID = "20261121-170459-3f9a1c07b2e"


class ValidationAsked(JudgeRequest):
    """A data set, and the model to judge on it; without a model kinds of hold-out are compared."""

    model_id: Annotated[
        str, told("The id of the model (that of its job); left out: hold-outs.", _MODEL_ID, max_length=200)
    ] = ""
    place: Annotated[
        bool,
        told(
            "Fit base, and tool where the model frees it, to the calibration rows, or without any to all.",
            False,
        ),
    ] = False
    everything: Annotated[
        bool, told("Judge on all measured rows, not on those alone that only judge.", False)
    ] = False


class SummaryShown(ResponseBody):
    """Figures of n errors, in the unit of the member's name."""

    n: Annotated[int, told("Number of errors.", 120)]
    mean: Annotated[float | None, told("Mean, in the unit of the member's name: mm or mrad.", 0.036)]
    std: Annotated[float | None, told("Standard deviation, mm or mrad.", 0.018)]
    mean_3std: Annotated[float | None, told("Mean and three standard deviations, mm or mrad.", 0.09)]
    rms: Annotated[float | None, told("Root mean square, mm or mrad.", 0.04)]
    p95: Annotated[float | None, told("95 % of them are less, mm or mrad.", 0.067)]
    max: Annotated[float | None, told("The largest, mm or mrad.", 0.09)]


Summary = Annotated[SummaryShown | None, told("Null where nothing of the kind was measured; mm, mrad.", None)]


class SphereShown(ResponseBody):
    """A ballbar check about one ball."""

    tool_target: Annotated[str, told("The target on the tool.", "T1")]
    base_target: Annotated[str, told("The ball in the centre.", "N1")]
    radius_mm: Annotated[float | None, told("Radius, mm.", 300.0)]
    n: Annotated[int, told("Number of distances.", 100)]
    mean_mm: Annotated[float | None, told("Mean error, mm.", 0.01)]
    std_mm: Annotated[float | None, told("Its standard deviation, mm.", 0.004)]
    max_mm: Annotated[float | None, told("The largest, mm.", 0.02)]


class GroupingShown(ResponseBody):
    """Errors by something."""

    by: Annotated[str, told("By what.", "branch")]
    position_mm: Annotated[dict[str, SummaryShown | None], told("Of positions, by group, mm.", {})] = Field(
        default_factory=dict
    )
    length_mm: Annotated[dict[str, SummaryShown | None], told("Of lengths, by group, mm.", {})] = Field(
        default_factory=dict
    )


class JudgementShown(ResponseBody):
    """The errors of one model."""

    model: Annotated[str, told("The model.", "nominal robot, placed")]
    position_mm: Summary
    length_mm: Summary
    spheres: Annotated[list[SphereShown], told("Ballbar checks.", [])]
    orientation_mrad: Summary
    pairs_mm: Annotated[
        dict[str, SummaryShown | None], told("Of distances between all pairs of points, by series, mm.", {})
    ]
    groups: Annotated[list[GroupingShown], told("By branch, target, side and the like.", [])]


class LengthRepeatability(ResponseBody):
    """The scatter of distances that were measured again."""

    poses: Annotated[int, told("Number of poses.", 8)]
    readings: Annotated[int, told("Number of readings.", 40)]
    std_mm: Annotated[float | None, told("Standard deviation, mm.", 0.002)]
    worst_std_mm: Annotated[float | None, told("That of the worst pose, mm.", 0.004)]


Angles = Annotated[list[float | None] | None, told("About x, y, z, mrad.", [0.1, 0.1, 0.2])]


class RepeatedPose(ResponseBody):
    """Pose accuracy and repeatability (ISO 9283)."""

    first_reading: Annotated[int | str, told("Id of its first reading.", 301)]
    visits: Annotated[int, told("Number of visits.", 30)]
    directions: Annotated[int, told("Number of directions of approach.", 1)]
    AP_p_mm: Annotated[float | None, told("Positioning accuracy, mm.", 0.4)]
    RP_l_mm: Annotated[float | None, told("Positioning repeatability, mm.", 0.02)]
    vAP_p_mm: Annotated[float | None, told("Multi-directional variation, mm.", None)]
    AP_xyz_mrad: Angles
    RP_xyz_mrad: Angles
    vAP_xyz_mrad: Angles


class RepeatedDistance(ResponseBody):
    """Distance accuracy and repeatability (ISO 9283)."""

    first_readings: Annotated[list[int | str], told("Ids of the two first readings.", [301, 331])]
    visits: Annotated[int, told("Number of visits.", 30)]
    AD_p_mm: Annotated[float | None, told("Distance accuracy, mm.", 0.1)]
    RD_mm: Annotated[float | None, told("Distance repeatability, mm.", 0.03)]


class Iso9283(ResponseBody):
    """Figures of ISO 9283, where poses were visited again."""

    visits_of_the_standard: Annotated[int, told("Number of visits that the standard asks for.", 30)]
    poses: Annotated[list[RepeatedPose], told("Poses.", [])]
    distances: Annotated[list[RepeatedDistance], told("Distances between them.", [])]


class DifferenceShown(ResponseBody):
    """A parameter in two calibrations."""

    name: Annotated[str, told("Its name.", "theta2")]
    unit: Unit
    first: Number
    u_first: Number
    second: Number
    u_second: Number
    difference: Number
    e_n: Number


class ComparisonShown(ResponseBody):
    """Two calibrations side by side."""

    models: Annotated[list[str], told("Their names.", ["a", "b"])]
    parameters: Annotated[list[DifferenceShown], told("Every parameter.", [])]
    prediction_difference_mm: Summary


class HoldOutShown(ResponseBody):
    """One kind of hold-out."""

    kind: Annotated[str, told("How readings were held out.", "random")]
    folds: Annotated[int, told("Number of folds.", 5)]
    error_mm: Summary
    left_out: Annotated[int, told("Number of readings that nothing can be said about.", 0)]


class ValidationResult(ResponseBody):
    """A model judged on readings, or kinds of hold-out side by side."""

    format: Annotated[Literal["truepose-validation/1"], told("The format.", "truepose-validation/1")]
    data: Annotated[DataShown, told("The readings.", {"readings": 300})]
    judged_on: Annotated[
        Literal["validation", "all"] | None, told("On which rows; null for hold-outs.", "validation")
    ] = None
    holdout: Annotated[str | None, told("How readings were held out.", "random")] = None
    placed: Annotated[bool, told("Base and tool were fitted to the calibration rows.", False)] = False
    judgements: Annotated[list[JudgementShown], told("The nominal robot, then the model.", [])] = Field(
        default_factory=list
    )
    length_repeatability: Annotated[LengthRepeatability | None, told("Of distances.", None)] = None
    iso9283: Annotated[Iso9283 | None, told("Where poses were visited again.", None)] = None
    comparison: Annotated[ComparisonShown | None, told("Where two models were judged.", None)] = None
    hold_outs: Annotated[list[HoldOutShown], told("Kinds of hold-out, where no model was given.", [])] = (
        Field(default_factory=list)
    )
    acceptance: Annotated[AcceptanceShown | None, told("Where limits were given.", None)] = None
    warnings: Annotated[
        list[str], told("What keeps the figures from meaning what they seem to, in sentences.", [])
    ] = Field(default_factory=list)
