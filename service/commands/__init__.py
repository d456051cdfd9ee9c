"""The commands of `truepose`, one file each.

A file is imported when its command is called, so that no command waits for the libraries of another.
"""

from __future__ import annotations

from importlib import import_module, metadata
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from service import written

# name -> its place, and the first sentence of its help (a test compares them)
COMMANDS = {
    "demo": ("demo.demo", "See the loop on a simulated robot with an undeclared effect."),
    "example": (
        "example.example_command",
        "Write the example files of Get started: simulated readings and two targets.",
    ),
    "calibrate": ("cell.calibrate.calibrate_command", "Calibrate the robot of a cell and verify it."),
    "verify": ("cell.verify.verify_command", "Verify a model on the robot."),
    "robot": ("files.robot.app", "Write, import and check the file of a robot of your own."),
    "convert": ("files.convert.convert", "Convert measurements of another program into a data set."),
    "align": ("files.align.align_command", "Align the streams of a moving robot and of a tracker."),
    "identify": ("models.identify.identify_command", "Identify the robot's parameters without a diagnosis."),
    "diagnose": ("models.diagnose.diagnose_command", "Identify, find what the model lacks, correct it."),
    "sweeps": ("models.sweeps.sweeps_command", "Analyse sweeps, in which one joint turns alone."),
    "regress": ("models.regress.regress_command", "Compare regression with identification."),
    "select": ("cell.select.select", "Choose calibration poses by observability."),
    "plan-ballbar": ("cell.plan_ballbar.plan_ballbar", "Find where the base balls should be."),
    "compensate": ("models.compensate.compensate_command", "Correct the targets of a program."),
    "export": ("files.export.export_command", "Write a model in another program's format."),
    "validate": ("models.validate.validate_command", "Judge a saved model, or compare kinds of hold-out."),
    "watch": ("watch.app", "Check with a few poses whether a robot has changed."),
    "doctor": ("cell.doctor.doctor_command", "Examine every device of a cell and list what to do."),
    "cell": ("cell.cell_file.app", "Write the JSON schema of cell files."),
    "campaign": ("cell.campaign.app", "Measure with a robot and an instrument."),
    "mock": ("mock.mock", "Simulate devices until SIGTERM or SIGINT."),
    "history": (
        "history.app",
        "Keep the results of robots over the years: trends, causes, dates of the next checks.",
    ),
    "fleet": ("fleet.app", "Keep the results of all robots of a plant in one place."),
    "serve": ("serve.serve", "Serve HTTP and the operator's page."),
    "conformance": ("conformance.conformance_command", "Try a driver of your own package on its simulator."),
    "docs": ("docs.docs_command", "Open the documentation."),
}
_SENTENCE = 200  # letters
_SETTINGS: Any = {"pretty_exceptions_enable": False, "rich_markup_mode": None, "add_completion": False}


class Group(TyperGroup):
    """A group that lists the first sentences of its commands in full.

    They take as many lines as a narrow terminal needs.
    """

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(
                [
                    (name, each.get_short_help_str(_SENTENCE))
                    for name, each in self.commands.items()
                    if not each.hidden
                ]
            )


class _Commands(Group):
    """The group knows its commands by name and summary; the one that is called is imported."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        name, known, rest = super().resolve_command(ctx, args)
        written.command = f"truepose {name}"
        return name, load(name) if name in COMMANDS else known, rest


def load(name: str) -> Any:
    """Import a command or group by its name."""
    module, _, attribute = COMMANDS[name][0].rpartition(".")
    found = getattr(import_module(f"service.commands.{module}"), attribute)
    if not isinstance(found, typer.Typer):
        alone = typer.Typer(**_SETTINGS)
        alone.command(name)(found)
        return get_command(alone)
    whole = typer.Typer(**_SETTINGS)
    whole.add_typer(found, name=name, no_args_is_help=True, cls=Group)
    group: Any = get_command(whole)
    return group.commands[name]


def _say_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"truepose {metadata.version('truepose')}")
        raise typer.Exit


_app = typer.Typer(
    cls=_Commands,
    name="truepose",
    help="Calibrate an industrial robot, name what its model lacks, correct it and prove the gain.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@_app.callback()
def truepose(
    version: Annotated[
        bool,
        typer.Option("--version", is_eager=True, callback=_say_version, help="Print the version and end."),
    ] = False,
    overwrite: Annotated[
        bool,
        typer.Option(
            "--overwrite",
            help="Replace also files that truepose did not write; may stand before or after the command.",
        ),
    ] = False,
) -> None:
    """Calibrate an industrial robot, name what its model lacks, correct it and prove the gain."""
    written.overwriting = overwrite


app: Any = get_command(_app)
for _name, (_, _summary) in COMMANDS.items():
    app.add_command(TyperCommand(_name, help=_summary))

__all__ = ["COMMANDS", "Group", "app", "load"]
