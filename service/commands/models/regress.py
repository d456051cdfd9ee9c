"""`truepose regress`: fit MLS-SVR to positions or residuals and compare it with the models.

The comparison is in sample and by waypoint.
"""

from __future__ import annotations

from typing import Annotated

import typer

from calib.errors import DataError
from calib.regression import SETS
from calib.text import replace_file
from service import wording
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed.regression_tables import shown
from service.printed.terminal import Terminal
from service.results.models.regressed import RegressionOutcome
from service.results.shape import document_of

METHODS = ("mls-svr",)


def regress_command(
    data: options.Data,
    method: Annotated[str, typer.Option(help=f"Regression method: {', '.join(METHODS)}.")] = METHODS[0],
    kernel: Annotated[
        str, typer.Option(help="Kernel: linear, or rbf, whose width is chosen from the readings.")
    ] = "linear",
    features: Annotated[
        str | None,
        typer.Option(
            help=f"Set of features: {', '.join(SETS)}. Default: the smallest set that describes the arm "
            "at these samples."
        ),
    ] = None,
    on: Annotated[
        str,
        typer.Option(
            help="Values that the regression predicts: residuals (of the model) or positions (absolute)."
        ),
    ] = "residuals",
    level: Annotated[
        int,
        typer.Option(
            min=2,
            max=3,
            help="Level of the model under the regression: 2 for geometry, 3 for geometry and compliance "
            "under gravity.",
        ),
    ] = 3,
    both: Annotated[
        bool,
        typer.Option(
            "--compare", help="Also fit the other level and the other kind of regression, for comparison."
        ),
    ] = False,
    diagnosed: Annotated[
        bool,
        typer.Option(
            "--diagnose", help="Also diagnose, and fit a regression to the errors that remain; slow."
        ),
    ] = False,
    model: options.Model = None,
    json: options.Json = None,
    report: options.Report = None,
) -> None:
    """Compare regression with identification. Both use the same readings. --model saves both together."""
    options.check_outputs(
        {"--json": json, "--model": model, "--report": report}, inputs=options.files_of(data)
    )
    if method not in METHODS:
        raise DataError(f"is {method!r}.", do=f"Use {', '.join(METHODS)}.", key="--method")
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {data}")
        result = RegressionOutcome.of(
            data,
            on=on,
            features=features,
            kernel=kernel,
            level=level,
            both=both,
            diagnosed=diagnosed,
            say=terminal.say,
        )
        options.write_result(document_of(result.result), json, terminal)
        sealed = result.save(model) if model is not None or report is not None else None
        if report is not None:
            from service.report import regression_report  # drawing takes long to import

            terminal.say("drawing the report")
            replace_file(report, regression_report(result.comparison, result.result, sealed))
        terminal.rest()
        if result.comparison.dataset.header.simulated:
            terminal.note(wording.SIMULATED)
        for each in shown(result.result):
            terminal.out.print(each)
        if model is not None and not result.gains:
            terminal.note("the regression adds nothing: the model is saved without it")
        for what, path in (("model", model), ("report", report)):
            if path is not None:
                terminal.note(f"{what}: {path}")
