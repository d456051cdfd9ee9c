"""`truepose fleet`: what many robots together say."""

from __future__ import annotations

import typer

from service.commands.fleet.learn import learn_command

app = typer.Typer(help="Learn from many robots together.")
app.command("learn")(learn_command)


@app.callback()
def fleet() -> None:
    """Learn from many robots together."""
