"""`truepose identify`: identify the base model, without a search for missing effects."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calib.data import read_dataset
from calib.errors import DataError
from calib.fit import left_out
from calib.saved import load_model, refuse_worse, save_model
from calib.text import replace_file
from calib.validation import refuse_other_robot
from service import wording
from service.commands import options
from service.commands.models.certificate import CertificateRequest, Dcc, DccAbout, read_parties
from service.files import STANDARD_OUTPUT
from service.printed import tables, type_tables
from service.printed.terminal import Terminal
from service.results.models.identified import IdentificationReport
from service.results.typed import TypeAgreementResponse


def identify_command(
    data: options.Data,
    json: options.Json = None,
    model: options.Model = None,
    report: options.Report = None,
    level: options.Level = None,
    preliminary: Annotated[
        Path | None,
        typer.Option(
            metavar="STAGE1.json",
            help="Model of stage 1 of a ballbar campaign; the report compares it with the nominal and the "
            "final model.",
        ),
    ] = None,
    prior: options.PriorFile = None,
    save_anyway: options.SaveAnyway = False,
    accept_rms: options.AcceptRms = None,
    accept_max: options.AcceptMax = None,
    accept_zones: options.AcceptZones = None,
    dcc: Dcc = None,
    dcc_about: DccAbout = None,
) -> None:
    """Identify the robot's parameters without a diagnosis."""
    options.check_outputs(
        {"--json": json, "--model": model, "--report": report, "--dcc": dcc},
        inputs=(*options.files_of(data), dcc_about, accept_zones, prior),
    )
    if preliminary is not None and report is None:
        raise DataError("is used only in a report.", do="Give --report.", key="--preliminary")
    limits = options.limits_of(accept_rms, accept_max, accept_zones)
    parties = read_parties(dcc_about, dcc, report)
    certificate = CertificateRequest.of(dcc, parties)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {data}")
        dataset = read_dataset(data)
        if certificate is not None:
            certificate.refuse_undated(dataset)
        result = IdentificationReport.of(dataset, level, terminal.say, limits, options.read_prior(prior))
        found = result.found
        stage = None if preliminary is None else load_model(preliminary)
        if preliminary is not None and stage is not None:
            refuse_other_robot(stage, dataset, preliminary)
        document = result.document()
        options.write_result(document, json, terminal)
        named = model is not None or report is not None or certificate is not None
        fit_to_save = found.converged and (save_anyway or not result.worse_than_nominal)
        sealed = save_model(model if fit_to_save else None, found) if named and found.converged else None
        if report is not None:
            terminal.say("drawing the report")
            replace_file(report, result.report(document, sealed, stage, parties))
        if certificate is not None:
            certificate.write(dataset, document, document["parameters"], sealed)
        terminal.rest()
        if dataset.header.simulated:
            terminal.note(wording.SIMULATED)
        for table in (
            tables.parameters(found),
            *type_tables.weights(TypeAgreementResponse.of(found)),
            tables.offsets(found),
            tables.left_out(left_out(dataset, found)),
            tables.warnings(wording.grouped(found.warnings)),
            tables.errors(
                {"nominal robot, placed": result.error_nominal, "identified": result.error_identified},
                dataset.header.holdout,
                wording.error_kind(dataset),
            ),
        ):
            terminal.out.print(table)
        terminal.out.print(tables.acceptance(result.acceptance))
        if model is not None and not fit_to_save:  # refused, when everything else is there
            save_model(None, found)
            refuse_worse(result.error_nominal, result.error_identified, model)
        _say_where(terminal, model, report, dcc)
    options.finish(result.acceptance, terminal)


def _say_where(terminal: Terminal, model: object, report: object, dcc: object) -> None:
    for what, path in (("model", model), ("report", report), ("certificate", dcc)):
        if path is not None:
            terminal.note(f"{what}: {path}")
