"""`truepose diagnose`: identify, find what the model lacks, refit, and judge on readings that took no part."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from acquisition import read_cell
from acquisition.follow_up import campaign_text, in_cell
from calib.dataset import Dataset, read_dataset
from calib.diagnose.carry import CarryOver, carry_over
from calib.diagnose.diagnosis import Diagnosis, diagnose
from calib.diagnose.select import MOST_EFFECTS
from calib.errors import DataError
from calib.files import replace_file
from calib.model_file import save_model
from service import documents, exit_codes, tables
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.patched import Patched
from service.predictions import predictions_csv
from service.terminal import Terminal


def diagnose_command(
    data: options.Data,
    json: options.Json = None,
    predictions: Annotated[
        Path | None,
        typer.Option(
            metavar="P.csv", help="Predict every validation row, with and without the effects found."
        ),
    ] = None,
    model: options.Model = None,
    report: options.Report = None,
    most: Annotated[int, typer.Option(min=0, help="Most effects that may be added.")] = MOST_EFFECTS,
    carry_to: Annotated[
        Path | None,
        typer.Option(
            metavar="B.csv", help="Judge the effects on another data set of the same robot as well."
        ),
    ] = None,
    follow_up: Annotated[
        Path | None,
        typer.Option(
            metavar="CAMPAIGN.toml", help="Where something is ambiguous, write poses that tell it apart."
        ),
    ] = None,
    cell: Annotated[
        Path | None,
        typer.Option(metavar="CELL.toml", help="Keep those poses within this cell: limits, table, boxes."),
    ] = None,
    patch: Annotated[
        bool, typer.Option("--patch", help="Map what is left as well: a patch, judged apart, never a cause.")
    ] = False,
    accept_rms: Annotated[
        float | None,
        typer.Option(metavar="MM", help="RMS error on validation rows asked for; not met: exit code 3."),
    ] = None,
) -> None:
    """Identify, find what the model lacks, correct it, and judge the gain on held-out readings."""
    options.check_outputs(
        {
            "--json": json,
            "--predictions": predictions,
            "--model": model,
            "--report": report,
            "--follow-up": follow_up,
        },
        inputs=(*options.files_of(data), *options.files_of(carry_to), cell),
    )
    if accept_rms is not None and not (math.isfinite(accept_rms) and accept_rms > 0.0):
        raise DataError(f"is {accept_rms:g}.", do="Give an error above 0 mm.", file="--accept-rms")
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {data}")
        dataset = read_dataset(data)
        other = None if carry_to is None else read_dataset(carry_to)
        the_cell = None if cell is None else read_cell(cell)
        if accept_rms is not None:
            _refuse_unjudged(dataset, data)
        diagnosis = diagnose(dataset, most=most, progress=terminal.say)
        if the_cell is not None and diagnosis.follow_up is not None:
            terminal.say("seeking poses of the cell that tell rivals apart")
            chosen = in_cell(the_cell, diagnosis.final, diagnosis.follow_up.rivals)
            diagnosis = replace(diagnosis, follow_up=chosen)
        carried = None
        if other is not None:
            terminal.say(f"judging the effects on {carry_to}")
            carried = carry_over(diagnosis, other)
        patched = None
        if patch:
            terminal.say("mapping what is left")
            patched = Patched.of(diagnosis)
        document = documents.of_diagnosis(diagnosis, carried, patched)
        options.write_result(document, json, terminal)
        write_results(
            diagnosis,
            document,
            terminal,
            predictions=predictions,
            model=model,
            report=report,
            carried=carried,
            patched=patched,
        )
        if follow_up is not None and diagnosis.follow_up is not None:
            replace_file(follow_up, campaign_text(diagnosis.follow_up, the_cell))
        terminal.rest()
        show(diagnosis, terminal, carried, patched)
        if follow_up is not None:
            terminal.note(
                "follow-up: nothing is ambiguous, no file was written"
                if diagnosis.follow_up is None
                else f"follow-up: {follow_up}"
            )
        for what, path in (("predictions", predictions), ("model", model), ("report", report)):
            if path is not None:
                terminal.note(f"{what}: {path}")
    reached = diagnosis.error_after
    if accept_rms is not None and reached is not None and reached.rms > accept_rms:
        terminal.note(f"truepose: {reached.rms:.4f} mm RMS is above the {accept_rms:g} mm asked for.")
        raise typer.Exit(exit_codes.NOT_MET)


def write_results(
    diagnosis: Diagnosis,
    document: Mapping[str, Any],
    terminal: Terminal,
    *,
    predictions: Path | None,
    report: Path | None,
    model: Path | None = None,
    carried: CarryOver | None = None,
    patched: Patched | None = None,
) -> None:
    """Write predictions, model and report, where they were asked for; what can fail most easily comes last."""
    if predictions is not None:
        replace_file(predictions, predictions_csv(diagnosis))
    if model is not None:
        save_model(model, diagnosis.final, diagnosis)
    if report is not None:
        # drawing is not needed for the numbers, and takes long to import
        from service.report import diagnosis_report

        terminal.say("drawing the report")
        replace_file(report, diagnosis_report(diagnosis, document, carried, patched))


def show(
    diagnosis: Diagnosis,
    terminal: Terminal,
    carried: CarryOver | None = None,
    patched: Patched | None = None,
) -> None:
    """Print the result for people."""
    for table in tables.diagnosis(diagnosis, carried, patched):
        terminal.out.print(table)


def _refuse_unjudged(dataset: Dataset, path: Path) -> None:
    if not dataset.validation_rows.any():
        raise DataError(
            "has no measured validation rows, so --accept-rms cannot be judged.",
            do="Mark some rows set = validation, or leave the option out.",
            file=path,
            key="set",
        )
