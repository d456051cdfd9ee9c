"""Result of a validation (`truepose-validation/1`): a saved model judged on readings.

Lengths are in mm and angles in mrad; null stands for missing values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field

from calib.array import Array
from calib.data import Dataset
from calib.errors import DataError
from calib.fit import base_model_of, place_nominal, silent
from calib.model import ModelStructure, named_only
from calib.saved import CalibratedModel
from calib.validation import (
    VISITS_OF_THE_STANDARD,
    DistanceFigures,
    Judgement,
    PoseFigures,
    Summary,
    apart,
    balls_of,
    differences,
    halved,
    hold_outs,
    judge,
    judge_repeats,
    knows_ends,
    of_the_robot,
    place,
    refuse_incomparable,
    refuse_other_robot,
)
from service.results.common import DataShown, Number, Unit, reading
from service.results.judgement.acceptance import AcceptanceLimits, AcceptanceResult, AcceptanceShown, decide
from service.results.shape import Real, ResponseBody, TableColumn, told

_FORMAT = "truepose-validation/1"
_MRAD = 1e3
_SAME_PLACE_MM = 0.01  # positions of a tool target that differ by less are taken as the same


class SummaryShown(ResponseBody):
    """Figures of n errors, in the unit of the member's name."""

    n: Annotated[int, told("Number of errors.", 120), TableColumn("n", str)]
    mean: Annotated[
        Real, told("Mean, in the unit of the member's name: mm or mrad.", 0.036), TableColumn("mean")
    ]
    std: Annotated[Real, told("Standard deviation, mm or mrad.", 0.018), TableColumn("std")]
    mean_3std: Annotated[
        Real, told("Mean and three standard deviations, mm or mrad.", 0.09), TableColumn("mean + 3 s")
    ]
    rms: Annotated[Real, told("Root mean square, mm or mrad.", 0.04), TableColumn("RMS")]
    p95: Annotated[Real, told("95 % of them are less, mm or mrad.", 0.067), TableColumn("95 %")]
    max: Annotated[Real, told("The largest, mm or mrad.", 0.09), TableColumn("max")]

    @classmethod
    def in_mrad(cls, found: Summary | None) -> Self | None:
        """Convert a summary of errors in rad to mrad; None from None."""
        if found is None:
            return None
        names = [name for name in cls.model_fields if name != "n"]
        return cls(n=found.n, **{name: _MRAD * getattr(found, name) for name in names})


SummaryOrNone = Annotated[
    SummaryShown | None, told("Null where nothing of the kind was measured; mm, mrad.", None)
]


class SphereShown(ResponseBody):
    """A ballbar check about one ball."""

    tool_target: Annotated[str, told("The target on the tool.", "T1", of="target")]
    base_target: Annotated[str, told("The ball in the centre.", "N1")]
    radius_mm: Annotated[Real, told("Radius, mm.", 300.0)]
    n: Annotated[int, told("Number of distances.", 100), TableColumn("n", str)]
    mean_mm: Annotated[Real, told("Mean error, mm.", 0.01), TableColumn("mean", "{:+.4f}".format)]
    std_mm: Annotated[Real, told("Its standard deviation, mm.", 0.004), TableColumn("std")]
    max_mm: Annotated[Real, told("The largest, mm.", 0.02, of="largest_mm"), TableColumn("max")]


Groups = dict[str, SummaryShown | None]


class GroupingShown(ResponseBody):
    """Errors by something."""

    by: Annotated[str, told("By what.", "branch")]
    position_mm: Annotated[Groups, told("Of positions, by group, mm.", {})] = Field(default_factory=dict)
    length_mm: Annotated[Groups, told("Of lengths, by group, mm.", {})] = Field(default_factory=dict)


class JudgementShown(ResponseBody):
    """The errors of one model."""

    model: Annotated[str, told("The model.", "nominal robot, placed")]
    position_mm: SummaryOrNone
    length_mm: SummaryOrNone
    spheres: Annotated[list[SphereShown], told("Ballbar checks.", [])]
    orientation_mrad: SummaryOrNone
    pairs_mm: Annotated[Groups, told("Of distances between all pairs of points, by series, mm.", {})]
    groups: Annotated[list[GroupingShown], told("By branch, target, side and the like.", [])]

    @classmethod
    def of(cls, found: Judgement) -> Self:
        """Describe the errors of a model that `calib` found."""
        kind = "length_mm" if found.position is None else "position_mm"
        parts = [{"by": part.title, kind: dict(part.groups)} for part in found.groupings]
        return cls.model_validate(
            {
                "model": found.name,
                "position_mm": found.position,
                "length_mm": found.length,
                "spheres": found.spheres,
                "orientation_mrad": SummaryShown.in_mrad(found.orientation),
                "pairs_mm": found.pairs,
                "groups": parts,
            }
        )

    @property
    def error(self) -> SummaryShown:
        """The error of positions, or of lengths if no position was measured."""
        found = self.position_mm or self.length_mm
        assert found is not None  # nothing is judged without either
        return found


class LengthRepeatability(ResponseBody):
    """The scatter of distances that were measured again."""

    poses: Annotated[int, told("Number of poses.", 8)]
    readings: Annotated[int, told("Number of readings.", 40)]
    std_mm: Annotated[Real, told("Standard deviation, mm.", 0.002)]
    worst_std_mm: Annotated[Real, told("That of the worst pose, mm.", 0.004, of="worst_mm")]


Angles = Annotated[list[Real] | None, told("About x, y, z, mrad.", [0.1, 0.1, 0.2])]


class RepeatedPose(ResponseBody):
    """Pose accuracy and repeatability (ISO 9283)."""

    first_reading: Annotated[int | str, told("Id of its first reading.", 301)]
    visits: Annotated[int, told("Number of visits.", 30)]
    directions: Annotated[int, told("Number of directions of approach.", 1)]
    AP_p_mm: Annotated[Real, told("Positioning accuracy, mm.", 0.4)]
    RP_l_mm: Annotated[Real, told("Positioning repeatability, mm.", 0.02)]
    vAP_p_mm: Annotated[Real, told("Multi-directional variation, mm.", None)]
    AP_xyz_mrad: Angles
    RP_xyz_mrad: Angles
    vAP_xyz_mrad: Angles

    @classmethod
    def of(cls, dataset: Dataset, found: PoseFigures) -> Self:
        """Describe the accuracy and repeatability of a pose that `calib` found."""

        def mrad(angles: tuple[float, ...] | None) -> list[float | None] | None:
            return None if angles is None else [_MRAD * angle for angle in angles]

        return cls(
            first_reading=reading(dataset.reading_id[found.reading]),
            visits=found.visits,
            directions=found.directions,
            AP_p_mm=found.accuracy,
            RP_l_mm=found.repeatability,
            vAP_p_mm=found.variation,
            AP_xyz_mrad=mrad(found.accuracy_angles),
            RP_xyz_mrad=mrad(found.repeatability_angles),
            vAP_xyz_mrad=mrad(found.variation_angles),
        )


class RepeatedDistance(ResponseBody):
    """Distance accuracy and repeatability (ISO 9283)."""

    first_readings: Annotated[list[int | str], told("Ids of the two first readings.", [301, 331])]
    visits: Annotated[int, told("Number of visits.", 30)]
    AD_p_mm: Annotated[Real, told("Distance accuracy, mm.", 0.1)]
    RD_mm: Annotated[Real, told("Distance repeatability, mm.", 0.03)]

    @classmethod
    def of(cls, dataset: Dataset, found: DistanceFigures) -> Self:
        """Describe the accuracy and repeatability of a distance that `calib` found."""
        return cls(
            first_readings=[reading(dataset.reading_id[row]) for row in found.readings],
            visits=found.visits,
            AD_p_mm=found.accuracy,
            RD_mm=found.repeatability,
        )


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
    prediction_difference_mm: SummaryOrNone


class HoldOutShown(ResponseBody):
    """One kind of hold-out."""

    kind: Annotated[str, told("How readings were held out.", "random")]
    folds: Annotated[int, told("Number of folds.", 5)]
    error_mm: Annotated[
        SummaryShown | None,
        told("Null where nothing of the kind was measured; mm, mrad.", None, of="errors"),
    ]
    left_out: Annotated[int, told("Number of readings that nothing can be said about.", 0)]


class BallsPlaced(ResponseBody):
    """Balls that the model did not know: distances placed them, with the robot as it is."""

    by: Annotated[
        Literal["calibration", "half"],
        told(
            "Calibration rows, or half of the poses where all rows judge. `half`: the others judge.", "half"
        ),
    ]
    distances: Annotated[int, told("Number of distances that placed them.", 40)]


class ValidationResult(ResponseBody):
    """A model judged on readings, or kinds of hold-out side by side."""

    format: Annotated[Literal["truepose-validation/1"], told("The format.", _FORMAT)]
    data: Annotated[DataShown, told("The readings.", {"readings": 300})]
    judged_on: Annotated[
        Literal["validation", "all"] | None, told("On which rows; null for hold-outs.", "validation")
    ] = None
    holdout: Annotated[str | None, told("How readings were held out.", "random")] = None
    placed: Annotated[bool, told("Base and tool were fitted to the calibration rows.", False)] = False
    balls: Annotated[
        BallsPlaced | None, told("Where distances placed balls, for every robot alike; null elsewhere.", None)
    ] = None
    judgements: Annotated[list[JudgementShown], told("The nominal robot, then the model.", [])] = Field(
        default_factory=list
    )
    length_repeatability: Annotated[LengthRepeatability | None, told("Of distances.", None)] = None
    iso9283: Annotated[Iso9283 | None, told("Where poses were visited again.", None)] = None
    comparison: Annotated[ComparisonShown | None, told("Where two models were judged.", None)] = None
    hold_outs: Annotated[list[HoldOutShown], told("Kinds of hold-out, where no model was given.", [])] = (
        Field(default_factory=list)
    )
    warnings: Annotated[
        list[str], told("What keeps the figures from meaning what they seem to, in sentences.", [])
    ] = Field(default_factory=list)
    acceptance: Annotated[AcceptanceShown | None, told("Where limits were given.", None)] = None


class LoadedModel(NamedTuple):
    """A model to judge and its file, and another to compare it with."""

    model: CalibratedModel
    path: Path
    second: CalibratedModel | None = None
    other: Path | None = None


@dataclass(frozen=True)
class ValidationRequest:
    """The options of a validation.

    Attributes
    ----------
    place : bool
        Whether base and tool are first fitted to the calibration rows; of distances, the balls.
    everything : bool
        Whether to judge on all measured rows.
    point : tuple of float or None
        Point in the world, mm; errors are also grouped by their distance from it.
    limits : AcceptanceLimits or None
        Limits of the error.

    Raises
    ------
    DataError
        The point is not three finite numbers.
    """

    place: bool = False
    everything: bool = False
    point: tuple[float, float, float] | None = None
    limits: AcceptanceLimits | None = None

    def __post_init__(self) -> None:
        given: tuple[Any, ...] = (0.0, 0.0, 0.0) if self.point is None else tuple(self.point)
        if len(given) != 3 or not all(isinstance(x, int | float) and math.isfinite(x) for x in given):
            raise DataError("is not three finite numbers.", do="Give X Y Z in mm.", file="--point")


@dataclass(frozen=True)
class ValidationOutcome:
    """Result of a validation, with the models from which a report draws its figures.

    The models are listed by name, each with the readings under its own loads.
    """

    dataset: Dataset
    result: ValidationResult
    model_sha256: str = ""
    models: Mapping[str, tuple[Dataset, ModelStructure, Array]] = field(
        default_factory=dict[str, tuple[Dataset, ModelStructure, Array]]
    )
    acceptance: AcceptanceResult | None = None


def validate(
    dataset: Dataset,
    read: LoadedModel | None,
    asked: ValidationRequest,
    say: Callable[[str], None] = silent,
) -> ValidationOutcome:
    """Judge a model, or compare kinds of hold-out if no model is given.

    Parameters
    ----------
    say : callable, optional
        Called with the name of each step.

    Raises
    ------
    DataError
        The model and the readings are of different robots, or they cannot be judged.
    """
    data = DataShown.of(dataset)
    if read is None:
        held = [HoldOutShown.model_validate(each) for each in hold_outs(dataset, progress=say)]
        return ValidationOutcome(dataset, ValidationResult(format=_FORMAT, data=data, hold_outs=held))
    saved, path, second, other = read
    refuse_other_robot(saved, dataset, path)
    as_read, dataset = dataset, saved.loaded(dataset)
    if second is not None and other is not None:
        refuse_incomparable(saved, second, other)
    rows = dataset.usable if asked.everything else dataset.validation_rows
    placed = asked.place or (second is not None and bool(dataset.pointed.any()))
    balls, both = None, [each.model for each in (saved, second) if each is not None]
    if (rows & dataset.spanned).any() and (
        (asked.place and not dataset.pointed.any())
        or not all(knows_ends(each, dataset, rows) for each in both)
    ):
        say("placing the balls by distances")
        by: Literal["calibration", "half"] = "calibration" if dataset.fit_rows.any() else "half"
        if by == "half":
            as_read, dataset = halved(as_read), halved(dataset)
            rows = dataset.usable if asked.everything else dataset.validation_rows
        balls = BallsPlaced(by=by, distances=int((dataset.fit_rows & dataset.spanned).sum()))
        placed = True
    base = base_model_of(dataset.placing) if balls is None else balls_of(dataset)

    def in_place(model: CalibratedModel) -> tuple[ModelStructure, Array]:
        own = (model.model, model.estimate)
        if balls is not None:
            return place_nominal(dataset, base, of_the_robot(*own))
        return place(dataset.placing, *own) if placed else own

    models = {
        "nominal robot, placed": place_nominal(dataset.placing, base),
        _name(path): in_place(saved),
    }
    if second is not None and other is not None:
        models[_name(other, unlike=_name(path))] = in_place(second)
    names = list(models)
    if any(effect.is_carried for effect in saved.model.effects):
        model, estimate, _ = named_only(saved.model, saved.estimate, saved.covariance)
        models[f"{_name(path)}, named causes only"] = in_place(replace(saved, model=model, estimate=estimate))
    under = {
        name: (dataset if second is None or name != names[-1] else second.loaded(as_read), *judged)
        for name, judged in models.items()
    }
    judgements = []
    for name, (loaded, model, estimate) in under.items():
        say(f"judging the {name}")
        judgements.append(judge(name, loaded, rows, model, estimate, asked.point))
    comparison = None
    if second is not None:
        comparison = ComparisonShown.model_validate(
            {
                "models": names[1:],
                "parameters": differences(saved, second),
                "prediction_difference_mm": apart(
                    dataset, rows & dataset.pointed, models[names[1]], models[names[2]]
                ),
            }
        )
    repeats = judge_repeats(dataset, *models[names[1]])
    accepted = None
    if asked.limits is not None:  # judged like the table: positions, or lengths if no point was measured
        on = rows & dataset.pointed if (rows & dataset.pointed).any() else rows
        accepted = decide(asked.limits, dataset, on, *models[names[1]], names[1])
    result = ValidationResult(
        format=_FORMAT,
        data=data,
        judged_on="all" if asked.everything else "validation",
        holdout=None if asked.everything else dataset.header.holdout,
        placed=placed,
        balls=balls,
        judgements=[JudgementShown.of(each) for each in judgements],
        length_repeatability=(
            None if repeats.lengths is None else LengthRepeatability.model_validate(repeats.lengths)
        ),
        iso9283=Iso9283(
            visits_of_the_standard=VISITS_OF_THE_STANDARD,
            poses=[RepeatedPose.of(dataset, each) for each in repeats.poses],
            distances=[RepeatedDistance.of(dataset, each) for each in repeats.distances],
        ),
        comparison=comparison,
        warnings=_warnings(dataset, saved, second, judgements, placed=placed, everything=asked.everything),
    )
    if balls is not None and asked.everything:
        result.warnings.append("The distances that placed the balls are among those judged: flatters.")
    if accepted is not None:
        result.acceptance = AcceptanceShown.model_validate(accepted)
    return ValidationOutcome(dataset, result, saved.sha256, under, accepted)


def _name(path: Path, unlike: str = "") -> str:
    """Name a model after its file: the bare name, or the whole path if two share the name."""
    return str(path) if path.stem == unlike else path.stem


def _warnings(
    dataset: Dataset,
    saved: CalibratedModel,
    second: CalibratedModel | None,
    judgements: Sequence[Judgement],
    *,
    placed: bool,
    everything: bool,
) -> list[str]:
    """List reasons not to trust these results at face value."""
    out = [*saved.notes, *(() if second is None else second.notes)]
    if everything and dataset.sha256 in (saved.data_sha256, "" if second is None else second.data_sha256):
        out.append("Rows to which the model was fitted are among those judged: flatters.")
    if second is not None and second.data_sha256 == saved.data_sha256:
        out.append("Both models come from the same readings; E_n supposes independent ones.")
    own, there = saved.holds_for.get("absolute_accuracy", "unknown"), dataset.header.absolute_accuracy
    if own != there:  # one is unknown: on against off was refused
        out.append(
            f"The controller's own absolute accuracy is {own} for the model and {there} for these readings: where they "
            "differ, the figures are of another robot."
        )
    out += [] if placed else _other_targets(dataset, saved)
    if not dataset.fit_rows.any():
        out.append(
            f"No calibration rows: the nominal robot{' and the model are' if placed else ' is'} placed by the "
            "rows that are judged, which flatters."
        )
    nominal, judged = judgements[0].error, judgements[1].error
    if not placed and judged.rms > nominal.rms:
        out.append(
            f"The model is worse than the nominal robot in its place ({judged.rms:.3f} against {nominal.rms:.3f} mm "
            "RMS): its frame may not be that of these readings; --place fits base and tool."
        )
    one_sided = [k for k, side in enumerate(saved.holds_for.get("approach", [])) if side != "both sides"]
    sides = dataset.conditions.side[dataset.usable]
    both = [str(k + 1) for k in one_sided if len(np.unique(sides[:, k])) > 1]
    if both:
        out.append(
            f"The model holds for an approach from one side; joints {', '.join(both)} came from both sides here."
        )
    return out


def _other_targets(dataset: Dataset, saved: CalibratedModel) -> list[str]:
    """List the tool targets that the header of the readings places elsewhere than the model."""
    freed = {parameter.name.partition(".")[0] for parameter in saved.model.parameters}
    out = []
    for series, known in saved.model.targets.items():
        of_header = dataset.header.targets_of(series)
        for name in sorted(({*known} & {*of_header}) - freed):
            apart = float(np.linalg.norm(np.subtract(known[name], of_header[name])))
            if apart > _SAME_PLACE_MM:
                out.append(
                    f"Target {name} lies {apart:.3g} mm from where the model holds it, which is judged with its own. "
                    "Another target gets a name of its own."
                )
    return out
