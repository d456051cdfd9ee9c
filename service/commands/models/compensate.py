"""`truepose compensate`: write a program with corrected targets.

With them the real robot lands where the program says.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from calib.errors import DataError
from service import exit_codes, wording
from service import written as written_files
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed.terminal import Terminal
from service.programs import (
    KnownFrames,
    compensate,
    compensation,
    named_frames,
    pulses_of,
    read_program,
    write_text,
)
from service.programs.compensation import REFUSED
from service.programs.conditions import stated_conditions


def compensate_command(
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="Identified model.")],
    program: Annotated[
        Path,
        typer.Argument(
            metavar="IN",
            help="Program to correct: targets .csv, RAPID .mod, Fanuc .ls, URScript .script, KUKA .src or "
            ".dat, Yaskawa .jbi, VAL3 .dtx.",
        ),
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="File for the corrected program.")],
    conditions: Annotated[
        str | None,
        typer.Option(
            metavar="KEY=VALUE,...",
            help="Conditions for which the correction holds: side, approach, temperature, time, mass, "
            "cog, series. Default: those of the model.",
        ),
    ] = None,
    tool: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]x,y,z,w,p,r", help="Tool that is not defined in the program, mm and deg."
        ),
    ] = None,
    frame: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]x,y,z,w,p,r",
            help="Work object or user frame that is not defined in the program, mm and deg.",
        ),
    ] = None,
    pulses: Annotated[
        str,
        typer.Option(metavar="P1,P2,...", help="Yaskawa: pulses per degree of every axis, with its sign."),
    ] = "",
    external_apart: Annotated[
        bool,
        typer.Option(
            "--fixed-external-axes",
            "--external-apart",
            help="External axes carry neither robot nor workpiece; keep their values.",
        ),
    ] = False,
    inverse: Annotated[
        bool,
        typer.Option(
            "--inverse", help="Convert targets that were taught on the real robot into nominal ones."
        ),
    ] = False,
    named_only: options.NamedOnly = False,
    keep_refused: Annotated[
        bool,
        typer.Option(
            "--keep-refused",
            help="Write the program even if some targets cannot be corrected; they stay unchanged.",
        ),
    ] = False,
    most_uncertainty: Annotated[
        float,
        typer.Option(
            metavar="MM",
            min=0.0,
            help="Largest uncertainty of a corrected position (95 %), mm; targets above it stay unchanged.",
        ),
    ] = math.inf,
    robot: options.RobotFile = None,
    largest_correction: options.LargestCorrection = options.LARGEST,
    json: options.Json = None,
) -> None:
    """Correct the targets of a program. All its other text stays as it is."""
    options.check_outputs({"OUT": out, "--json": json}, inputs=(model, program))
    if out.suffix.lower() != program.suffix.lower():
        raise DataError(
            "is named as another kind of program than IN.", do=f"Let it end in {program.suffix}.", file=out
        )
    known = KnownFrames(
        named_frames("--tool", tool or []),
        named_frames("--frame", frame or []),
        pulses_of("--pulses", pulses),
        external_apart,
    )
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {model} and {program}")
        saved, usable = options.read_for_use(model, robot, largest_correction, named_only=named_only)
        stated = stated_conditions(conditions, saved)
        read = read_program(program, saved.model.robot, known)
        terminal.say(f"correcting {wording.counted(len(read.targets), 'target')}")
        done = compensate(
            read, program, saved, stated.stated, known, inverse=inverse, most_mm=most_uncertainty
        )
        refused = done.of(REFUSED)
        notes = list(stated.notes)
        if not inverse and (written_files.writer_of(program) or "").endswith("compensate OUT"):
            notes.append(
                f"{program} was written by truepose compensate: unless by --inverse, it is corrected twice."
            )
        written = keep_refused or not refused
        document = {
            "format": compensation.FORMAT,
            "model": str(model),
            "robot": saved.model.robot.name,
            "program": str(program),
            "out": str(out) if written else None,
            "direction": "actual to nominal" if inverse else "nominal to actual",
            "conditions": stated.document,
            **compensation.document(done),
            **compensation.of_carried(usable),
            "warnings": notes,
        }
        options.write_result(document, json, terminal)
        if written:
            write_text(out, done.text)
        terminal.rest()
        for each in compensation.shown(done):
            terminal.out.print(each)
        if any(outcome.left for outcome in done.outcomes) and not known.tools:
            terminal.note(
                "truepose: the flange lands; a tool is off by the tilt that is left times its length. --tool lets its "
                "point land."
            )
        for note in notes:
            terminal.note(f"truepose: {note}")
        if not written:
            more = f" and {len(refused) - 1} more" if len(refused) > 1 else ""
            raise DataError(
                f"target '{refused[0].target.name}'{more} cannot be corrected: {refused[0].why}. Nothing was written.",
                do="Change the target, or leave it as it is with --keep-refused.",
                file=program,
                line=refused[0].target.line,
            )
        terminal.out.print(f"{out}: {compensation.in_words(done)}. Holds for: {stated.in_words}.")
    if refused:
        raise typer.Exit(exit_codes.NOT_MET)
