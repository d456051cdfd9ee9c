"""`truepose fleet`: collect and keep the results of a plant's cells about their robots."""

from __future__ import annotations

import typer

from service.commands import Group
from service.commands.fleet.demo import demo_command
from service.commands.fleet.diagnose import diagnose_command
from service.commands.fleet.learn import learn_command
from service.commands.fleet.migrate import migrate_command
from service.commands.fleet.outbox import app as outbox
from service.commands.fleet.send import send_command
from service.commands.fleet.serve import serve_command
from service.commands.fleet.token import app as token

app = typer.Typer(help="Keep the results of all robots of a plant in one place.")
app.command("send")(send_command)
app.add_typer(outbox, name="outbox", no_args_is_help=True, cls=Group)
app.command("serve")(serve_command)
app.add_typer(token, name="token", no_args_is_help=True, cls=Group)
app.command("diagnose")(diagnose_command)
app.command("learn")(learn_command)
app.command("demo")(demo_command)
app.command("migrate")(migrate_command)
