"""`truepose fleet learn`: what robots of one type share, from their model files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calib.prior import TypeMember, learn, prior_document, save_prior
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed import type_tables
from service.printed.terminal import Terminal
from service.results.shape import document_of
from service.results.typed import TypeStatisticsResult


def learn_command(
    models: Annotated[
        list[Path],
        typer.Argument(metavar="MODEL.json...", help="Models of robots of one type, one per robot."),
    ],
    out: Annotated[
        Path, typer.Option("--out", metavar="PRIOR.json", help="File for the prior of the next robot.")
    ],
    robot: options.RobotFile = None,
    json: options.Json = None,
) -> None:
    """Learn what robots of one type share."""
    options.check_outputs({"--out": out, "--json": json}, inputs=(*models, robot))
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        members = []
        for path in models:
            terminal.say(f"reading {path}")
            members.append(TypeMember.read(path, robot_file=robot))
        terminal.say(f"learning from {len(members)} robots")
        found = learn(members)
        described = TypeStatisticsResult.model_validate(prior_document(found))
        options.write_result(document_of(described), json, terminal)
        save_prior(out, found)
        terminal.rest()
        for shown in type_tables.lesson(described):
            terminal.out.print(shown)
        terminal.note(f"prior: {out}")
