"""`truepose fleet send`: send new documents of a folder to a fleet's server.

They go through an outbox.
"""

from __future__ import annotations

import socket
import time
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer
from filelock import FileLock, Timeout

from calib.errors import DataError
from fleet.outbox import FILE, CellFolder, Outbox, Sender, SendRound, ServerLink, collect
from fleet.store import utc_now
from service import exit_codes, wording
from service.commands import options
from service.ending import ShutdownSignal, until_asked
from service.files import STANDARD_OUTPUT
from service.printed.terminal import Terminal, duration
from service.private import owner_only, read_secret
from service.results.robots import read_record

Folder = Annotated[
    Path, typer.Argument(metavar="FOLDER", help="Folder with models, watches, data sets and records.")
]
ROUNDS = 6  # of a command that ends by itself


@owner_only()
def send_command(
    folder: Folder,
    to: Annotated[
        str, typer.Option("--to", metavar="URL", help="Address of the fleet's server, http://ADDRESS:PORT.")
    ],
    token_file: Annotated[
        Path,
        typer.Option("--token-file", metavar="FILE", help="File with the cells' token in its first line."),
    ],
    cell: options.CellName = None,
    serial: options.Serial = "",
    simulated: Annotated[
        bool,
        typer.Option("--simulated", help="Send documents of simulated robots too; use a separate store."),
    ] = False,
    every: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            min=0.1,
            help="Time between two searches for new documents, s, until Ctrl-C. Default: one search.",
        ),
    ] = None,
    json: options.Json = None,
) -> None:
    """Send the new documents in FOLDER. What cannot be sent waits in FOLDER/outbox.sqlite3, for weeks if need be."""
    options.check_outputs({"--json": json}, inputs=(token_file,))
    if not folder.is_dir():
        raise DataError("there is no such folder.", do="Name the folder of the records.", file=folder)
    whose = CellFolder(socket.gethostname() if cell is None else cell, serial, simulated)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal, until_asked() as ending:
        if to.startswith("http://") and not _is_near(to):
            terminal.note("truepose: the token goes over the network as it is; use https:// there.")
        lock = FileLock(folder / f"{FILE}.lock")
        try:
            lock.acquire(timeout=0)
        except Timeout as error:
            raise DataError(
                "is being sent by another program.", do="Let it work, or end it first.", file=folder
            ) from error
        with lock, Outbox(folder / FILE) as outbox, closing(ServerLink(to, _token(token_file))) as link:
            sender = Sender(outbox, link, say=terminal.note)
            if every is None:
                done = _once(folder, whose, sender, ending, terminal)
            else:
                _on_and_on(folder, whose, sender, every, ending, terminal)
                return
        terminal.rest()
        options.write_result(_document(done), json, terminal)
        terminal.out.print(_in_words(done))
    if done.waiting or done.refused:
        code = exit_codes.USAGE if done.barred else exit_codes.NOT_AVAILABLE
        raise typer.Exit(code if done.waiting else exit_codes.FAILED)


def _once(
    folder: Path, cell: CellFolder, sender: Sender, ending: ShutdownSignal, terminal: Terminal
) -> SendRound:
    """Collect and send once.

    It ends when nothing is left, the server is away, or a document has failed several times.
    """
    collect(folder, cell, sender.outbox, utc_now, terminal.note, read_record)
    kept = refused = 0
    done = SendRound()
    for number in range(ROUNDS):
        terminal.say("sending")
        done = sender.round(lambda: bool(ending))
        kept, refused = kept + done.kept, refused + done.refused
        if done.wait_s is None or done.trouble or number == ROUNDS - 1 or ending.wait(done.wait_s):
            break
    return SendRound(kept, refused, done.waiting, done.trouble, done.barred)


def _on_and_on(
    folder: Path, cell: CellFolder, sender: Sender, every_s: float, ending: ShutdownSignal, terminal: Terminal
) -> None:
    """Collect at intervals and send waiting documents until the command is asked to end.

    Changes are reported.
    """
    look_at, said = time.monotonic(), ""
    while not ending:
        wait_s: float | None = None
        try:
            if time.monotonic() >= look_at:
                look_at = time.monotonic() + every_s
                collect(folder, cell, sender.outbox, utc_now, terminal.note, read_record)
            done = sender.round(lambda: bool(ending))
            wait_s, trouble = done.wait_s, done.trouble
            if done.kept:
                terminal.note(f"{wording.counted(done.kept, 'document')} sent, {done.waiting} wait.")
        except DataError as error:  # a full disk, say: what waits, waits
            trouble = str(error)
        if trouble and trouble != said:
            again = f" Tried again in {duration(wait_s)} and later." if wait_s else ""
            terminal.note(f"truepose: {trouble}{again}")
        if trouble or wait_s is None:
            said = trouble
        left = max(0.0, look_at - time.monotonic())
        ending.wait(left if wait_s is None else min(left, wait_s))


def _token(file: Path) -> str:
    lines = read_secret(file, "send in the name of the cells").split()
    if not lines:
        raise DataError("is empty.", do="Put the cells' token into it.", file=file)
    return lines[0]


def _is_near(url: str) -> bool:
    from urllib.parse import urlsplit

    from service.http.access.connections import is_loopback

    return is_loopback(urlsplit(url).hostname or "")


def _document(done: SendRound) -> dict[str, object]:
    return {
        "format": "truepose-sent/1",
        "sent": done.kept,
        "refused": done.refused,
        "waiting": done.waiting,
        "trouble": done.trouble,
    }


def _in_words(done: SendRound) -> str:
    parts = [f"{wording.counted(done.kept, 'document')} sent"]
    if done.refused:
        parts.append(f"{done.refused} set aside (truepose fleet outbox list)")
    if done.waiting:
        parts.append(f"{done.waiting} wait")
    text = f"{', '.join(parts)}."
    return f"{text} {done.trouble}" if done.trouble else text
