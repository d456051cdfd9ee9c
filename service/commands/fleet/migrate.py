"""`truepose fleet migrate`: create the tables of a store, or update them to this version."""

from __future__ import annotations

import typer

from fleet.store import READER, WRITER, migrate
from service.commands.history import StoreArgument
from service.printed.terminal import Terminal


def migrate_command(
    store: StoreArgument,
    roles: bool = typer.Option(
        False, "--roles", help=f"Make the roles {READER} and {WRITER} of a PostgreSQL, for its users."
    ),
) -> None:
    """Make the tables of a store, or update those of an older version; all or nothing."""
    with Terminal() as terminal:
        terminal.say("migrating")
        before, after = migrate(store, roles=roles)
        terminal.rest()
        if before == after:
            terminal.out.print(f"The tables are those of this version already ({after}).")
        else:
            terminal.out.print(f"The tables are at version {after} now; before: {before or 'none'}.")
