"""`truepose fleet outbox`: waiting, refused and rejected documents, with the reasons."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calib.errors import DataError
from fleet.outbox import FILE, Outbox, QueuedDocument
from fleet.store import utc_now
from service import wording
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.json_values import utc_text
from service.printed import tables
from service.printed.terminal import Terminal
from service.private import owner_only

app = typer.Typer(help="List the documents that wait, and send refused ones again.")
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder given to 'truepose fleet send'.")]
SHORT = 12  # letters of a hash that people type
MOST = 50  # documents in a table


@app.command("list")
def list_command(folder: Folder, json: options.Json = None) -> None:
    """List waiting documents, and those that cannot be sent.

    A reason is shown for each document set aside and each file not taken.
    """
    options.check_outputs({"--json": json})
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal, _opened(folder) as outbox:
        waiting, aside = outbox.entries("waiting"), outbox.entries("aside")
        not_taken, sent = outbox.not_taken(), len(outbox.entries("sent"))
        document = {
            "format": "truepose-outbox/1",
            "waiting": [_of(entry) for entry in waiting],
            "set_aside": [_of(entry) for entry in aside],
            "not_taken": [{"file": str(path), "reason": said} for path, said in not_taken],
            "sent": sent,
        }
        options.write_result(document, json, terminal)
        terminal.rest()
        for title, entries in (("Waiting", waiting), ("Set aside", aside)):
            if entries:
                terminal.out.print(_table(f"{title}: {wording.counted(len(entries), 'document')}", entries))
        if not_taken:
            table = tables.grid(f"Not taken: {wording.counted(len(not_taken), 'file')}", "reason", left=1)
            for _, said in not_taken[:MOST]:
                table.add_row(said)
            terminal.out.print(table)
        terminal.out.print(
            f"{sent} sent, {len(waiting)} wait, {len(aside)} set aside, {len(not_taken)} files not taken."
        )


@app.command("retry")
@owner_only()
def retry_command(
    folder: Folder,
    hash: Annotated[
        str,
        typer.Argument(
            metavar="[HASH]", help="Start of the hash of the documents to send again (default: all)."
        ),
    ] = "",
) -> None:
    """Send documents again that were set aside. Files that were not taken are read again."""
    with Terminal() as terminal, _opened(folder) as outbox:
        again = [entry.hash for entry in outbox.entries("aside") if entry.hash.startswith(hash)]
        if hash and not again:
            raise DataError(f"nothing set aside begins with '{hash}'.", do="List them first.", file=folder)
        count = sum(outbox.retry(each, utc_now()) for each in again)
        if not hash:
            outbox.look_again()
        terminal.rest()
        terminal.out.print(
            f"{wording.counted(count, 'document')} will be sent again by 'truepose fleet send'."
        )


def _opened(folder: Path) -> Outbox:
    if not (folder / FILE).is_file():
        raise DataError(
            "has no outbox: nothing was sent from it.", do="Send first: truepose fleet send.", file=folder
        )
    return Outbox(folder / FILE)


def _of(entry: QueuedDocument) -> dict[str, object]:
    return {
        "hash": entry.hash,
        "kind": entry.kind,
        "serial": entry.robot.serial,
        "model": entry.robot.model,
        "identity": entry.identity,
        "bytes": entry.size,
        "measured_utc": utc_text(entry.measured_at.timestamp()),
        "tries": entry.tries,
        "reason": entry.said,
    }


def _table(title: str, entries: list[QueuedDocument]) -> tables.Table:
    table = tables.grid(title, "hash", "kind", "robot", "tries", "reason", left=5)
    for entry in entries[:MOST]:
        table.add_row(entry.hash[:SHORT], entry.kind, entry.robot.serial, str(entry.tries), entry.said or "-")
    if len(entries) > MOST:
        table.caption = f"The oldest {MOST}; all with --json -."
    return table
