"""A saved model judged on readings, for the command line and for the jobs of the service (`truepose-validation/1`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from calib.array import Array
from calib.data import Dataset
from calib.fit import base_model_of, place_nominal, silent
from calib.model import ModelStructure, named_only
from calib.saved import CalibratedModel
from calib.validation import (
    Difference,
    Judgement,
    Repeats,
    Summary,
    apart,
    differences,
    judge,
    judge_repeats,
    place,
    refuse_incomparable,
    refuse_other_robot,
)
from service.results.judgement import validation_document
from service.results.judgement.acceptance import AcceptanceLimits, AcceptanceResult, decide

_SAME_PLACE_MM = 0.01  # by which a tool target may be written elsewhere


class LoadedModel(NamedTuple):
    """A model to judge and its file, and another to set beside it."""

    model: CalibratedModel
    path: Path
    second: CalibratedModel | None = None
    other: Path | None = None


@dataclass(frozen=True)
class ValidationRequest:
    """The question: how to judge. placed: base and tool fitted to the calibration rows; everything: on all measured
    rows; point: of the world, mm, from which errors are shown by distance; limits: that the error is held to."""

    placed: bool = False
    everything: bool = False
    point: tuple[float, float, float] | None = None
    limits: AcceptanceLimits | None = None


@dataclass(frozen=True)
class Validated:
    """The judgements, first that of the nominal robot, and what else is said of them."""

    dataset: Dataset
    asked: ValidationRequest
    placed: bool
    judgements: Sequence[Judgement]
    repeats: Repeats
    names: Sequence[str]
    models: Mapping[
        str, tuple[Dataset, ModelStructure, Array]
    ]  # each under the loads that it was judged under
    parameters: Sequence[Difference]
    between: Summary | None
    acceptance: AcceptanceResult | None
    warnings: Sequence[str]

    @staticmethod
    def of(
        dataset: Dataset, read: LoadedModel, asked: ValidationRequest, say: Callable[[str], None] = silent
    ) -> Validated:
        """Judge. Raises DataError."""
        saved, path, second, other = read
        refuse_other_robot(saved, dataset, path)
        as_read, dataset = dataset, saved.loaded(dataset)
        if second is not None and other is not None:
            refuse_incomparable(saved, second, other)
        rows = dataset.usable if asked.everything else dataset.validation_rows
        placed = asked.placed or (second is not None and bool(dataset.pointed.any()))

        def in_place(model: CalibratedModel) -> tuple[ModelStructure, Array]:
            return (
                place(dataset.placing, model.model, model.estimate)
                if placed
                else (model.model, model.estimate)
            )

        models = {
            "nominal robot, placed": place_nominal(dataset.placing, base_model_of(dataset.placing)),
            _name(path): in_place(saved),
        }
        if second is not None and other is not None:
            models[_name(other, unlike=_name(path))] = in_place(second)
        names = list(models)
        if any(effect.is_carried for effect in saved.model.effects):
            model, estimate, _ = named_only(saved.model, saved.estimate, saved.covariance)
            models[f"{_name(path)}, named causes only"] = in_place(
                replace(saved, model=model, estimate=estimate)
            )
        under = {
            name: (dataset if second is None or name != names[-1] else second.loaded(as_read), *judged)
            for name, judged in models.items()
        }
        judgements = []
        for name, (loaded, model, estimate) in under.items():
            say(f"judging the {name}")
            judgements.append(judge(name, loaded, rows, model, estimate, asked.point))
        parameters, between = [], None
        if second is not None:
            parameters = differences(saved, second)
            between = apart(dataset, rows & dataset.pointed, models[names[1]], models[names[2]])
        acceptance = None
        if (
            asked.limits is not None
        ):  # on what a table shows: positions, or lengths where no point was measured
            on = rows & dataset.pointed if (rows & dataset.pointed).any() else rows
            acceptance = decide(asked.limits, dataset, on, *models[names[1]], names[1])
        return Validated(
            dataset,
            asked,
            placed,
            judgements,
            judge_repeats(dataset, *models[names[1]]),
            names,
            under,
            parameters,
            between,
            acceptance,
            _warnings(dataset, saved, second, judgements, placed=placed, everything=asked.everything),
        )

    def document(self) -> dict[str, Any]:
        """Document of the result, as JSON has it."""
        comparison = None
        if len(self.names) > 2:
            comparison = validation_document.comparison_of(self.names[1:], self.parameters, self.between)
        document = validation_document.of_validation(
            self.dataset,
            judged_on="all" if self.asked.everything else "validation",
            placed=self.placed,
            judgements=self.judgements,
            repeats=self.repeats,
            warnings=self.warnings,
            comparison=comparison,
        )
        if self.acceptance is not None:
            document["acceptance"] = self.acceptance.document()
        return document


def _name(path: Path, unlike: str = "") -> str:
    """A model by its file: the bare name, or the whole path where two share it."""
    return str(path) if path.stem == unlike else path.stem


def _warnings(
    dataset: Dataset,
    saved: CalibratedModel,
    second: CalibratedModel | None,
    judgements: list[Judgement],
    *,
    placed: bool,
    everything: bool,
) -> list[str]:
    """Reasons not to trust these figures at face value."""
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
    """Sentences on tool targets that the header of the readings places elsewhere than the model holds them."""
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
