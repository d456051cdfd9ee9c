"""`truepose serve`: the HTTP service, on loopback unless a token was chosen for more."""

from __future__ import annotations

import errno
import gc
import ipaddress
import os
import re
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib import import_module
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from filelock import FileLock, Timeout

from calib.errors import DataError
from service import exit_codes
from service.commands import history, serving
from service.json_log import json_log
from service.private import (
    NAME,
    VARIABLE,
    chosen_token,
    lasting_tokens,
    note_if_others_read,
    owner_only,
    refuse_foreign,
    tokens_until_the_end,
)

if TYPE_CHECKING:
    from service.http.access.roles import ServiceSettings

_APP = "service.http.app"
_ADDRESS = r"https?://\S+, process \d+\n"
_HOST = re.compile(r"(?:[A-Za-z0-9_-]{1,63}\.){0,10}[A-Za-z][A-Za-z0-9-]{0,62}")  # its last part is no number


@owner_only()
def serve(
    cell: Annotated[
        Path | None, typer.Option(metavar="CELL.toml", help="The cell; without it nothing can be measured.")
    ] = None,
    simulate: Annotated[bool, typer.Option("--simulate", help="Measure with the cell's simulators.")] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: a free one.")] = 0,
    record: Annotated[Path, typer.Option(metavar="DIR", help="Folder for all files of the service.")] = Path(
        "truepose-record"
    ),
    host: serving.Host = "127.0.0.1",
    token_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File that keeps the operator's token and, in its second line, the viewer's; it is made where it is "
            f"not there. Else {VARIABLE}, or new ones at every start, in DIR/{NAME}.",
        ),
    ] = None,
    store: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help=f"Store of the history of robots, as for 'truepose history', or {history.VARIABLE}, which is "
            "ignored with --simulate. Default: a file in DIR.",
        ),
    ] = None,
    permitted: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            min=1e-6,
            help="Largest position error permitted, RMS: dates of the next checks go by it.",
        ),
    ] = None,
    json: serving.Hello = False,
    log: serving.Log = None,
) -> None:
    """Serve HTTP and the operator's page.

    Prints the address and the access keys when ready. Nothing moves until a client starts it.
    """
    refuse_host(host)
    token = chosen_token() if token_file is None else None
    if token is None and token_file is None and not is_loopback(host):
        sys.stderr.write(
            f"truepose: refused to listen on {host} without a token of your own: everybody on that network could "
            f"move the robot. Set {VARIABLE} or give --token-file.\n"
        )
        raise typer.Exit(exit_codes.REFUSED)
    if simulate and cell is None:
        raise DataError("needs a cell to simulate.", do="Give --cell CELL.toml.", key="--simulate")
    record = record.absolute()
    lasting = None if token_file is None else lasting_tokens(token_file)
    with ExitStack() as stack:
        gc.disable()  # until `run_server`: what is imported stays, and looking through it took a quarter of the start
        stack.callback(gc.enable)  # where it is not reached
        from acquisition import read_cell

        the_cell = None if cell is None else read_cell(cell)
        announce = stack.enter_context(_sole_service(record))
        stack.enter_context(json_log(log))
        simulated = None
        if simulate and the_cell is not None:
            threading.Thread(target=import_module, args=(_APP,)).start()  # while the simulators start
            from service.simulated_cell import simulated_cell

            simulated = stack.enter_context(simulated_cell(the_cell))
        from service.http.access.roles import ServiceSettings
        from service.http.app import create_app
        from service.http.server import run_server

        tokens = lasting or stack.enter_context(tokens_until_the_end(record, token))
        note_if_others_read(record)
        if the_cell is not None and not simulate:
            from acquisition.examination import note_low_priority

            note_low_priority()
        settings = ServiceSettings(
            record=record,
            tokens=tokens,
            token_file=(token_file or record / NAME).absolute(),
            cell=the_cell,
            simulated=simulated,
            host=host,
            store=store or (None if simulate else os.environ.get(history.VARIABLE)),
            permitted_mm=permitted,
        )
        text = _for_programs if json else _for_people

        def hello(url: str) -> str:
            announce(url)
            return text(settings, url)

        code = run_server(create_app(settings), host, port, tokens, hello)
    if code != exit_codes.DONE:
        raise typer.Exit(code)


@contextmanager
def _sole_service(record: Path) -> Iterator[Callable[[str], object]]:
    """Reserve the record folder for this service while the block lasts.

    Yields a function to call with the address of the service.

    Raises
    ------
    DataError
        Another service has the folder; the message states its address and process.
    """
    where = record / "service.txt"
    with ExitStack() as held:
        try:
            record.mkdir(parents=True, exist_ok=True)
            lock = FileLock(record / "service.lock", thread_local=False)
            lock.acquire(timeout=0)
            held.callback(lock.release)
            free = sys.platform != "linux" or _lock_in_kernel(held, record)
        except Timeout:
            free = False
        except OSError as error:
            raise DataError(
                f"cannot be written ({error.strerror}).", do="Give another folder with --record.", file=record
            ) from error
        if not free:
            address = where.read_text("utf-8").strip() if where.is_file() else ""
            raise DataError(
                f"is served already{f' at {address}' if address else ''}.",
                do="Use that service, end it, or give another folder with --record.",
                file=record,
            )
        refuse_foreign(where, _ADDRESS)
        held.callback(where.unlink, missing_ok=True)
        yield lambda url: where.write_text(f"{url}, process {os.getpid()}\n", "utf-8")


def _lock_in_kernel(held: ExitStack, folder: Path) -> bool:
    """Lock a folder in addition to its lock file, which a person may delete.

    It works as `acquisition.run.orders.robot_lock` locks a robot. Returns False if another service has the folder.
    """
    found = folder.stat()
    try:
        lock = held.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        lock.bind(f"\0truepose-service-{found.st_dev}-{found.st_ino}")
    except OSError as error:  # where such sockets are not allowed there is the file
        return error.errno != errno.EADDRINUSE
    return True


def _for_programs(settings: ServiceSettings, url: str) -> str:
    hello = {
        "url": url,
        "token": settings.tokens.operator,
        "viewer_token": settings.tokens.viewer,
        "token_file": str(settings.token_file),
    }
    return dumps(hello)


def _for_people(settings: ServiceSettings, url: str) -> str:
    cell = "no cell: nothing can be measured" if settings.cell is None else f"the cell {settings.cell.name}"
    simulated = "" if settings.simulated is None else ", SIMULATED"
    return "\n".join(
        (
            f"Ready: {cell}{simulated}. Nothing moves until somebody asks for it.",
            f"  page           {url}/",
            f"  token          {settings.tokens.operator}",
            f"  viewer's token {settings.tokens.viewer}   (reads, pauses and stops)",
            f"  tokens are in  {settings.token_file}",
            f"  interface      {url}/docs",
            "Ctrl-C pauses whatever runs and ends the service.",
        )
    )


def refuse_host(host: str) -> None:
    """Refuse a host that is neither an address nor a name.

    The system takes '' and '0' for all its addresses.

    Raises
    ------
    DataError
        The host is neither.
    """
    try:
        ipaddress.ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError as error:
        if not _HOST.fullmatch(host):
            raise DataError(
                f"{host!r} is not an address.",
                do="Give an address or a name of this computer, or 0.0.0.0 for all of its addresses.",
                key="--host",
            ) from error


def is_loopback(host: str) -> bool:
    """Return whether only this computer can reach the address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
