"""`truepose validate`: a saved model judged on readings that took no part, or hold-outs of several kinds compared."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

from calib.array import Array
from calib.data import Dataset, read_dataset
from calib.errors import DataError
from calib.fit import base_model_of, place_nominal
from calib.model import RobotModel
from calib.saved import SavedModel
from calib.validation import (
    Judgement,
    apart,
    differences,
    hold_outs,
    judge,
    judge_repeats,
    place,
    refuse_incomparable,
    refuse_other_robot,
)
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed import validation_tables
from service.printed.tables import acceptance as acceptance_table
from service.printed.tables import warnings as warnings_table
from service.printed.terminal import Terminal
from service.results import validation_document
from service.results.acceptance import Limits, decide


class Read(NamedTuple):
    """A model to judge and its file, and another to set beside it."""

    model: SavedModel
    path: Path
    second: SavedModel | None
    other: Path | None


def validate_command(
    data: options.Data,
    model: Annotated[
        Path | None,
        typer.Option(metavar="M.json", help="Judge this saved model; without it: hold-outs side by side."),
    ] = None,
    compare: Annotated[
        Path | None,
        typer.Option(metavar="N.json", help="Another calibration of the same robot, set beside --model."),
    ] = None,
    place_it: Annotated[
        bool,
        typer.Option(
            "--place", help="Fit base (and tool, where the model frees it) to the calibration rows."
        ),
    ] = False,
    everything: Annotated[
        bool, typer.Option("--all", help="Judge on all measured rows, not on the validation rows alone.")
    ] = False,
    point: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Show errors by the distance from this point of the world, mm."),
    ] = None,
    robot: options.RobotFile = None,
    largest_correction: options.LargestCorrection = options.LARGEST,
    accept_rms: options.AcceptRms = None,
    accept_max: options.AcceptMax = None,
    json: options.Json = None,
) -> None:
    """Judge a saved model, or compare kinds of hold-out."""
    inputs = [path for path in (model, compare) if path is not None]
    options.check_outputs({"--json": json}, inputs=(*options.files_of(data), *inputs))
    limits = Limits.of(accept_rms, accept_max)
    if model is None and (limits or compare is not None or place_it or everything or point is not None):
        raise DataError(
            "is missing: --compare, --place, --all, --point, --accept-rms and --accept-max go with it.",
            do="Give the model to judge with --model M.json.",
            file="--model",
        )
    if point is not None and not all(math.isfinite(x) for x in point):
        raise DataError("is not three finite numbers.", do="Give X Y Z in mm.", file="--point")
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {data}")
        dataset = read_dataset(data)
        if model is None:
            _hold_outs(dataset, json, terminal)
        else:
            saved = options.read_model(model, robot, largest_correction)
            second = None if compare is None else options.read_model(compare, robot, largest_correction)
            for each in filter(None, (saved, second)):
                options.note_without_regression(each, terminal)
            read = Read(saved, model, second, compare)
            _judge(dataset, read, point, limits, json, terminal, placed=place_it, everything=everything)


def _hold_outs(dataset: Dataset, json: str | None, terminal: Terminal) -> None:
    found = hold_outs(dataset, progress=terminal.say)
    options.write_result(validation_document.of_hold_outs(dataset, found), json, terminal)
    terminal.rest()
    for table in validation_tables.held_out(found):
        terminal.out.print(table)


def _judge(
    dataset: Dataset,
    read: Read,
    point: tuple[float, float, float] | None,
    limits: Limits | None,
    json: str | None,
    terminal: Terminal,
    *,
    placed: bool,
    everything: bool,
) -> None:
    saved, path, second, other = read
    refuse_other_robot(saved, dataset, path)
    if second is not None and other is not None:
        refuse_incomparable(saved, second, other)
    rows = dataset.usable if everything else dataset.validation_rows
    placed = placed or (second is not None and bool(dataset.pointed.any()))

    def in_place(model: SavedModel) -> tuple[RobotModel, Array]:
        return place(dataset, model.model, model.estimate) if placed else (model.model, model.estimate)

    models = {
        "nominal robot, placed": place_nominal(dataset, base_model_of(dataset)),
        _name(path): in_place(saved),
    }
    if second is not None and other is not None:
        models[_name(other, unlike=_name(path))] = in_place(second)
    judgements = []
    for name, judged in models.items():
        terminal.say(f"judging the {name}")
        judgements.append(judge(name, dataset, rows, *judged, point))
    names = list(models)
    repeats = judge_repeats(dataset, *models[names[1]])
    warnings = _warnings(dataset, saved, second, judgements, placed=placed, everything=everything)
    comparison, shown = None, []
    if second is not None:
        parameters = differences(saved, second)
        between = apart(dataset, rows & dataset.pointed, models[names[1]], models[names[2]])
        comparison = validation_document.comparison_of(names[1:], parameters, between)
        shown = list(validation_tables.compared((names[1], names[2]), parameters, between))
    acceptance = None
    if limits is not None:  # on what the table shows: positions, or lengths where no point was measured
        judged = rows & dataset.pointed if (rows & dataset.pointed).any() else rows
        acceptance = decide(limits, dataset, judged, *models[names[1]], names[1])
    document = validation_document.of_validation(
        dataset,
        judged_on="all" if everything else "validation",
        placed=placed,
        judgements=judgements,
        repeats=repeats,
        warnings=warnings,
        comparison=comparison,
    )
    if acceptance is not None:
        document["acceptance"] = acceptance.document()
    options.write_result(document, json, terminal)
    terminal.rest()
    for table in (
        *validation_tables.judged(judgements, None if everything else dataset.header.holdout),
        *validation_tables.repeated(dataset, repeats, names[1]),
        *shown,
        acceptance_table(acceptance),
        warnings_table(warnings),
    ):
        terminal.out.print(table)
    options.finish(acceptance, terminal)


def _name(path: Path, unlike: str = "") -> str:
    """A model by its file: the bare name, or the whole path where two share it."""
    return str(path) if path.stem == unlike else path.stem


def _warnings(
    dataset: Dataset,
    saved: SavedModel,
    second: SavedModel | None,
    judgements: list[Judgement],
    *,
    placed: bool,
    everything: bool,
) -> list[str]:
    """What keeps these figures from meaning what they seem to mean."""
    out = [*saved.notes, *(() if second is None else second.notes)]
    if everything and dataset.sha256 in (saved.data_sha256, "" if second is None else second.data_sha256):
        out.append("Rows to which the model was fitted are among those judged: flatters.")
    if second is not None and second.data_sha256 == saved.data_sha256:
        out.append("Both models come from the same readings; E_n supposes independent ones.")
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
