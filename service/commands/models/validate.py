"""`truepose validate`: judge a saved model on held-out readings, or compare hold-outs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calib.data import read_dataset
from calib.errors import DataError
from calib.text import replace_file
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed import validation_tables
from service.printed.tables import acceptance as acceptance_table
from service.printed.tables import warnings as warnings_table
from service.printed.terminal import Terminal
from service.results.judgement.validation import (
    LoadedModel,
    ValidationOutcome,
    ValidationRequest,
    validate,
)
from service.results.shape import document_of


def validate_command(
    data: options.Data,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="M.json",
            help="Saved model to judge. Default: fit models to parts of the readings and compare their hold-outs.",
        ),
    ] = None,
    compare: Annotated[
        Path | None,
        typer.Option(
            metavar="N.json", help="Another calibration of the same robot, to compare with --model."
        ),
    ] = None,
    place: Annotated[
        bool,
        typer.Option(
            "--place",
            help="Fit the base (and the tool, if the model frees it) to the calibration rows, or to all rows if there "
            "are none. With distances, fit the positions of the balls.",
        ),
    ] = False,
    everything: Annotated[
        bool, typer.Option("--all", help="Judge on all measured rows, not on the validation rows alone.")
    ] = False,
    point: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Point of the world, mm: show errors by their distance from it."),
    ] = None,
    report: options.Report = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.svg",
            help="File for a picture of the errors: arrows, or with distances a chart over time.",
        ),
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
    outputs = {"--json": json, "--report": report, "--picture": picture}
    options.check_outputs(outputs, inputs=(*options.files_of(data), *inputs, accept_zones))
    limits = options.limits_of(accept_rms, accept_max, accept_zones)
    drawn = report is not None or picture is not None
    if model is None and (limits or compare is not None or place or everything or point is not None or drawn):
        raise DataError(
            "is missing: --compare, --place, --all, --point, --report, --picture, --accept-rms, --accept-max and "
            "--accept-zones go with it.",
            do="Give the model to judge with --model M.json.",
            file="--model",
        )
    if everything and drawn:
        raise DataError(
            "cannot be combined with --report or --picture, which show only readings that took no part in the fit.",
            do="Leave it out, or mark the rows to judge on set = validation.",
            file="--all",
        )
    asked = ValidationRequest(place, everything, point, limits)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {data}")
        dataset = read_dataset(data)
        read = None
        if model is not None:
            saved = options.read_model(model, robot, largest_correction)
            second = None if compare is None else options.read_model(compare, robot, largest_correction)
            for each in filter(None, (saved, second)):
                options.note_without_regression(each, terminal)
            read = LoadedModel(saved, model, second, compare)
        found = validate(dataset, read, asked, terminal.say)
        options.write_result(document_of(found.result), json, terminal)
        if drawn:
            _draw(found, report, picture, terminal)
        terminal.rest()
        for table in validation_tables.validation(found.result):
            terminal.out.print(table)
        if read is not None:
            terminal.out.print(acceptance_table(found.acceptance))
            terminal.out.print(warnings_table(found.result.warnings))
        for what, path in (("report", report), ("picture", picture)):
            if path is not None:
                terminal.note(f"{what}: {path}")
        options.finish(found.acceptance, terminal)


def _draw(found: ValidationOutcome, report: Path | None, picture: Path | None, terminal: Terminal) -> None:
    """Write the requested report and picture."""
    # drawing is not needed for the numbers, and takes long to import
    from service.report import judged_in, validation_report

    terminal.say("drawing")
    if report is not None:
        replace_file(report, validation_report(found))
    if picture is not None:
        section = judged_in(found)[1]
        replace_file(picture, section["arrows"] or section["over_time"])
