"""`truepose serve`: the HTTP service, on loopback unless a token was chosen for more."""

from __future__ import annotations

import errno
import gc
import os
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
from service.http.access.connections import broker_at, is_loopback, listener_at, refuse_host
from service.json_log import json_log
from service.private import (
    NAME,
    VARIABLE,
    chosen_token,
    lasting_tokens,
    note_if_others_read,
    owner_only,
    read_secret,
    refuse_foreign,
    tokens_until_the_end,
)

if TYPE_CHECKING:
    from service.http.access.roles import LivePublisher, ServiceSettings

MQTT_VARIABLE = "TRUEPOSE_MQTT_PASSWORD"
_APP = "service.http.app"
_ADDRESS = r"https?://\S+, process \d+\n"


@owner_only()
def serve(
    cell: Annotated[
        Path | None, typer.Option(metavar="CELL.toml", help="Cell file; without it nothing can be measured.")
    ] = None,
    simulate: Annotated[bool, typer.Option("--simulate", help="Measure with the cell's simulators.")] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on, 0 for a free one.")] = 0,
    record: Annotated[Path, typer.Option(metavar="DIR", help="Folder for all files of the service.")] = Path(
        "truepose-record"
    ),
    host: serving.Host = "127.0.0.1",
    token_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File with the operator's token and, in its second line, the viewer's; it is made if it "
            f"does not exist. Default: the tokens in {VARIABLE}, or new ones at every start, in DIR/{NAME}.",
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
            help="Largest permitted position error, mm RMS, from which the dates of the next checks are computed.",
        ),
    ] = None,
    mqtt: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Broker that gets live values, mqtts://USER@HOST:PORT; mqtt:// only on this computer.",
        ),
    ] = None,
    mqtt_password: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help=f"File with the password of USER. Else {MQTT_VARIABLE}."),
    ] = None,
    mqtt_ca: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Certificate of the broker's authority, PEM. Default: those of the system."
        ),
    ] = None,
    opcua: Annotated[
        str | None,
        typer.Option(metavar="[HOST:]PORT", help="Address on which an OPC UA server shows live values."),
    ] = None,
    json: serving.Hello = False,
    log: serving.Log = None,
) -> None:
    """Serve HTTP and the operator's page.

    Prints the address and the access keys when ready. Nothing moves until a client starts it.
    """
    refuse_host(host)
    token = chosen_token() if token_file is None else None
    place = None if opcua is None else listener_at(opcua)
    for each, harm in (
        (host, "move the robot"),
        (place[0] if place else "localhost", "read what it measures"),
    ):
        if token is None and token_file is None and not is_loopback(each):
            sys.stderr.write(
                f"truepose: refused to listen on {each} without a token of your own: everybody on that network could "
                f"{harm}. Set {VARIABLE} or give --token-file.\n"
            )
            raise typer.Exit(exit_codes.REFUSED)
    if mqtt is None and (mqtt_password or mqtt_ca):
        raise DataError("is missing.", do="Give the address of the broker.", key="--mqtt")
    broker = None if mqtt is None else broker_at(mqtt, _password(mqtt_password), mqtt_ca)
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
        name = socket.gethostname() if the_cell is None else the_cell.name
        publishers: list[LivePublisher] = []
        if broker is not None:
            from service.http.live.mqtt import mqtt_publisher  # of the extra `mqtt`

            publishers.append(stack.enter_context(mqtt_publisher(broker, name)))
        if place is not None:
            from service.http.live.opcua import OpcuaServer  # of the extra `opcua`

            publishers.append(stack.enter_context(OpcuaServer(name, *place, tokens, record / "opcua")))
        settings = ServiceSettings(
            record=record,
            tokens=tokens,
            token_file=(token_file or record / NAME).absolute(),
            cell=the_cell,
            simulated=simulated,
            host=host,
            store=store or (None if simulate else os.environ.get(history.VARIABLE)),
            permitted_mm=permitted,
            publishers=tuple(publishers),
        )
        text = _for_programs if json else _for_people

        def hello(url: str) -> str:
            announce(url)
            return text(settings, url)

        code = run_server(create_app(settings), host, port, tokens, hello)
    if code != exit_codes.DONE:
        raise typer.Exit(code)


def _password(file: Path | None) -> str:
    """Return the password for the broker; empty if there is none."""
    text = (
        os.environ.get(MQTT_VARIABLE, "")
        if file is None
        else read_secret(file, "send in the name of this cell")
    )
    return text.strip()


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
