"""The commands of `truepose`: one file each, gathered here into one Typer app."""

from __future__ import annotations

from importlib import metadata
from typing import Annotated

import typer

from service.commands import (
    align,
    campaign,
    compensate,
    convert,
    demo,
    diagnose,
    docs,
    doctor,
    export,
    identify,
    mock,
    plan_ballbar,
    regress,
    select,
    serve,
    sweeps,
    validate,
    watch,
)

app = typer.Typer(
    name="truepose",
    help="Calibrate an industrial robot, name what its model lacks, correct it and prove the gain.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _say_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"truepose {metadata.version('truepose')}")
        raise typer.Exit


@app.callback()
def truepose(
    version: Annotated[
        bool,
        typer.Option("--version", is_eager=True, callback=_say_version, help="Print the version and end."),
    ] = False,
) -> None:
    """Calibrate an industrial robot, name what its model lacks, correct it and prove the gain."""


app.command("demo")(demo.demo)
app.command("convert")(convert.convert)
app.command("align")(align.align_command)
app.command("identify")(identify.identify_command)
app.command("diagnose")(diagnose.diagnose_command)
app.command("sweeps")(sweeps.sweeps_command)
app.command("regress")(regress.regress_command)
app.command("select")(select.select)
app.command("plan-ballbar")(plan_ballbar.plan_ballbar)
app.command("compensate")(compensate.compensate_command)
app.command("export")(export.export_command)
app.command("validate")(validate.validate_command)
app.command("doctor")(doctor.doctor_command)
app.add_typer(campaign.app, name="campaign", no_args_is_help=True)
app.add_typer(watch.app, name="watch", no_args_is_help=True)
app.command("mock")(mock.mock)
app.command("serve")(serve.serve)
app.command("docs")(docs.docs_command)

__all__ = ["app"]
