"""`truepose identify`: the parameters of the base model, without any search for missing effects."""

from __future__ import annotations

from typing import Annotated

import typer

from calib.dataset import read_dataset
from calib.effects.base_model import LEVELS
from calib.files import replace_file
from calib.held_out import errors_on
from calib.identify import identify
from calib.model_file import save_model
from calib.placing import base_model_of, place_nominal
from calib.statistics import statistics_of
from service import documents, tables, wording
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.terminal import Terminal


def identify_command(
    data: options.Data,
    json: options.Json = None,
    model: options.Model = None,
    report: options.Report = None,
    level: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=3,
            help="1 joints, 2 geometry, 3 and gravity; instead of what the header's [model] frees.",
        ),
    ] = None,
) -> None:
    """Identify the robot's parameters, nothing else."""
    options.check_outputs(
        {"--json": json, "--model": model, "--report": report}, inputs=options.files_of(data)
    )
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {data}")
        dataset = read_dataset(data)
        groups = None if level is None else LEVELS[level]
        found = identify(dataset, groups=groups, progress=terminal.say)
        rows = dataset.validation_rows
        nominal, placed = place_nominal(dataset, base_model_of(dataset, groups))
        error_nominal = statistics_of(errors_on(dataset, rows, nominal, placed))
        error_identified = statistics_of(errors_on(dataset, rows, found.model, found.estimate))
        document = documents.of_identification(dataset, found, error_nominal, error_identified)
        options.write_result(document, json, terminal)
        if model is not None:
            save_model(model, found)
        if report is not None:
            # drawing is not needed for the numbers, and takes long to import
            from service.report import identification_report

            terminal.say("drawing the report")
            replace_file(report, identification_report(dataset, found, nominal, placed, document))
        terminal.rest()
        for table in (
            tables.parameters(found),
            tables.warnings(wording.grouped(found.warnings)),
            tables.errors(
                {"nominal robot, placed": error_nominal, "identified": error_identified},
                dataset.header.holdout,
                wording.error_kind(dataset),
            ),
        ):
            terminal.out.print(table)
        _say_where(terminal, model, report)


def _say_where(terminal: Terminal, model: object, report: object) -> None:
    for what, path in (("model", model), ("report", report)):
        if path is not None:
            terminal.note(f"{what}: {path}")
