"""`truepose validate`: a saved model judged on readings that took no part, or hold-outs of several kinds compared."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from calib.data import Dataset, read_dataset
from calib.errors import DataError
from calib.validation import hold_outs
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed import validation_tables
from service.printed.tables import acceptance as acceptance_table
from service.printed.tables import warnings as warnings_table
from service.printed.terminal import Terminal
from service.results.judgement import validation_document
from service.results.judgement.validated import Question, Read, Validated


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
    accept_zones: options.AcceptZones = None,
    json: options.Json = None,
) -> None:
    """Judge a saved model, or compare kinds of hold-out."""
    inputs = [path for path in (model, compare) if path is not None]
    options.check_outputs({"--json": json}, inputs=(*options.files_of(data), *inputs, accept_zones))
    limits = options.limits_of(accept_rms, accept_max, accept_zones)
    if model is None and (limits or compare is not None or place_it or everything or point is not None):
        raise DataError(
            "is missing: --compare, --place, --all, --point, --accept-rms, --accept-max and --accept-zones go with it.",
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
            asked = Question(place_it, everything, point, limits)
            _judge(dataset, read, asked, json, terminal)


def _hold_outs(dataset: Dataset, json: str | None, terminal: Terminal) -> None:
    found = hold_outs(dataset, progress=terminal.say)
    options.write_result(validation_document.of_hold_outs(dataset, found), json, terminal)
    terminal.rest()
    for table in validation_tables.held_out(found):
        terminal.out.print(table)


def _judge(dataset: Dataset, read: Read, asked: Question, json: str | None, terminal: Terminal) -> None:
    found = Validated.of(dataset, read, asked, terminal.say)
    options.write_result(found.document(), json, terminal)
    terminal.rest()
    shown = []
    if len(found.names) > 2:
        both = (found.names[1], found.names[2])
        shown = list(validation_tables.compared(both, found.parameters, found.between))
    for table in (
        *validation_tables.judged(found.judgements, None if asked.everything else dataset.header.holdout),
        *validation_tables.repeated(dataset, found.repeats, found.names[1]),
        *shown,
        acceptance_table(found.acceptance),
        warnings_table(found.warnings),
    ):
        terminal.out.print(table)
    options.finish(found.acceptance, terminal)
