"""`truepose diagnose`: identify, find missing effects, refit, judge on held-out readings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acquisition import read_cell
from acquisition.loop import campaign_text
from calib.data import read_dataset
from calib.diagnose import MOST_EFFECTS
from calib.saved import save_model
from calib.text import replace_file
from service import wording
from service.commands import options
from service.commands.models.certificate import CertificateRequest, Dcc, DccAbout, read_parties
from service.files import STANDARD_OUTPUT
from service.gc_pause import left_alone
from service.printed import tables, type_tables
from service.printed.terminal import Terminal
from service.results.models.diagnosed import DiagnosisOutcome, DiagnosisRequest
from service.results.models.parameters import rows_of
from service.results.models.predictions import predictions_csv
from service.results.shape import document_of
from service.results.typed import TypeAgreementResponse

if TYPE_CHECKING:
    from service.report.certificate import CertificateParties


def diagnose_command(
    data: options.Data,
    json: options.Json = None,
    predictions: Annotated[
        Path | None,
        typer.Option(
            metavar="P.csv",
            help="File for the predictions of every validation row, with and without the effects found.",
        ),
    ] = None,
    model: options.Model = None,
    report: options.Report = None,
    most: Annotated[
        int, typer.Option("--max-effects", "--most", min=0, help="Largest number of effects to add.")
    ] = MOST_EFFECTS,
    carry_to: Annotated[
        Path | None,
        typer.Option(
            metavar="B.csv",
            help="Another data set of the same robot, on which the effects are judged as well.",
        ),
    ] = None,
    follow_up: Annotated[
        Path | None,
        typer.Option(
            metavar="CAMPAIGN.toml",
            help="File for a campaign of poses that distinguish the rivals, if the diagnosis is ambiguous.",
        ),
    ] = None,
    cell: Annotated[
        Path | None,
        typer.Option(
            metavar="CELL.toml",
            help="Cell file, within whose limits, table and boxes the poses of --follow-up are kept.",
        ),
    ] = None,
    patch: Annotated[
        bool,
        typer.Option(
            "--patch",
            help="Also map the remaining errors: a patch, judged separately and never named as a cause.",
        ),
    ] = False,
    prior: options.PriorFile = None,
    save_anyway: options.SaveAnyway = False,
    accept_rms: options.AcceptRms = None,
    accept_max: options.AcceptMax = None,
    accept_zones: options.AcceptZones = None,
    dcc: Dcc = None,
    dcc_about: DccAbout = None,
) -> None:
    """Identify, find what the model lacks, correct it. The gain is judged on held-out readings."""
    options.check_outputs(
        {
            "--json": json,
            "--predictions": predictions,
            "--model": model,
            "--report": report,
            "--follow-up": follow_up,
            "--dcc": dcc,
        },
        inputs=(*options.files_of(data), *options.files_of(carry_to), cell, dcc_about, accept_zones, prior),
    )
    limits = options.limits_of(accept_rms, accept_max, accept_zones)
    parties = read_parties(dcc_about, dcc, report)
    certificate = CertificateRequest.of(dcc, parties)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {data}")
        dataset, of_type = read_dataset(data), options.read_prior(prior)
        if certificate is not None:
            certificate.refuse_undated(dataset)
        the_cell = None if cell is None else read_cell(cell)
        asked = DiagnosisRequest(
            most=most,
            prior=of_type,
            carry_to=None if carry_to is None else read_dataset(carry_to),
            patch=patch,
            cell=the_cell,
            limits=limits,
        )
        outcome = DiagnosisOutcome.of(dataset, asked, terminal.say)
        diagnosis, document = outcome.diagnosis, outcome.document()
        options.write_result(document, json, terminal)
        sealed = write_results(
            outcome,
            document,
            terminal,
            predictions=predictions,
            model=model if save_anyway or not diagnosis.worse_than_nominal else None,
            save_anyway=save_anyway,
            report=report,
            certified=certificate is not None,
            parties=parties,
        )
        if certificate is not None:
            parameters = [document_of(row) for row in rows_of(diagnosis.final)]
            certificate.write(dataset, document, parameters, sealed)
        if follow_up is not None and diagnosis.follow_up is not None:
            replace_file(follow_up, campaign_text(diagnosis.follow_up, the_cell))
        terminal.rest()
        if dataset.header.simulated:
            terminal.note(wording.SIMULATED)
        show(outcome, terminal)
        terminal.out.print(tables.acceptance(outcome.acceptance))
        unfit = not diagnosis.final.converged or (diagnosis.worse_than_nominal and not save_anyway)
        if model is not None and unfit:  # refused, when everything else is there
            save_model(model, diagnosis.final, diagnosis)
        if follow_up is not None:
            terminal.note(
                "follow-up: nothing is ambiguous, no file was written"
                if diagnosis.follow_up is None
                else f"follow-up: {follow_up}"
            )
        for what, path in (
            ("predictions", predictions),
            ("model", model),
            ("report", report),
            ("certificate", dcc),
        ):
            if path is not None:
                terminal.note(f"{what}: {path}")
    options.finish(outcome.acceptance, terminal)


def write_results(
    outcome: DiagnosisOutcome,
    document: Mapping[str, Any],
    terminal: Terminal,
    *,
    predictions: Path | None,
    report: Path | None,
    model: Path | None = None,
    save_anyway: bool = False,
    certified: bool = False,
    parties: CertificateParties | None = None,
) -> str | None:
    """Write the requested predictions, model and report.

    The step that fails most easily comes last. Returns the hash of the model. It is None if the fit did not
    converge, or if neither a file nor a certificate (`certified`) names the model.
    """
    diagnosis = outcome.diagnosis
    if predictions is not None:
        replace_file(predictions, predictions_csv(diagnosis))
    named = certified or model is not None or report is not None
    sealed = None
    if named and diagnosis.final.converged:
        sealed = save_model(model, diagnosis.final, diagnosis, save_anyway=save_anyway)
    if report is not None:
        # drawing is not needed for the numbers, and takes long to import
        from service.report import diagnosis_report

        terminal.say("drawing the report")
        with left_alone():
            page = diagnosis_report(
                diagnosis,
                document,
                outcome.carried,
                outcome.patched,
                acceptance=outcome.acceptance,
                model_sha256=sealed,
                parties=parties,
            )
        replace_file(report, page)
    return sealed


def show(outcome: DiagnosisOutcome, terminal: Terminal) -> None:
    """Print the result for people."""
    for table in type_tables.weights(TypeAgreementResponse.of(outcome.diagnosis.final)):
        terminal.out.print(table)
    for table in tables.diagnosis(outcome.diagnosis, outcome.carried, outcome.patched):
        terminal.out.print(table)
