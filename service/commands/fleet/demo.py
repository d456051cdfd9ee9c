"""`truepose fleet demo`: a fleet on this computer.

It has a server with its store, simulated cells, and workers that diagnose. Each cell is an ABB IRB 120 with its
own serial number and errors. Its own sender runs next to it, as on the cell PC. The cells measure one after the
other. They begin with a campaign and a model. Then each makes a watch, again and again until Ctrl-C. Each step
is a command that a person could type. It is printed, runs below a guard and ends with this command. The output
of the commands is in DIR/demo.log.
"""

from __future__ import annotations

import json as notation
import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Annotated

import typer

from acquisition.loop import rehearsal
from calib.errors import DataError
from calib.text import read_text, replace_file
from service import exit_codes
from service.child import python
from service.ending import ShutdownSignal, until_asked
from service.ids import new_id
from service.private import lasting_tokens, owner_only

POSES, JUDGED = 30, 12  # of a campaign
TIME_SCALE = 500.0
SEND_S = 2.0
GRACE_S = 5.0
_EFFECTS = ("backlash:j4", "none", "periodic:j2:n2", "joint_offset:j5")  # of the cells, in turn


class _Stopped(Exception):
    """The demo was asked to end."""


@owner_only()
def demo_command(
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for all files; an existing one is continued.")
    ] = Path("fleet-demo"),
    store: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Address of the store, postgresql://USER@HOST/NAME. Default: an SQLite file in DIR.",
        ),
    ] = None,
    cells: Annotated[int, typer.Option(min=1, max=20, help="Number of simulated cells.")] = 3,
    workers: Annotated[int, typer.Option(min=1, max=64, help="Number of processes that diagnose.")] = 2,
    every: Annotated[
        float,
        typer.Option(metavar="S", min=60.0, help="Time between two rounds of watches, s."),
    ] = 120.0,
    once: Annotated[bool, typer.Option("--once", help="End after the first round.")] = False,
) -> None:
    """Run a demo fleet here: a server, simulated cells that send to it, workers that diagnose."""
    if out.exists() and (not out.is_dir() or (any(out.iterdir()) and not (out / "tokens").exists())):
        raise DataError("is not empty and holds no demo.", do="Name another folder.", file=f"--out {out}")
    out.mkdir(parents=True, exist_ok=True)
    tokens = lasting_tokens(out / "tokens", first="cells'", harm="write to the store")
    place = store or f"sqlite:///{(out / 'plant.sqlite3').absolute()}"
    with until_asked() as ending, ExitStack() as stack:
        try:
            log = stack.enter_context((out / "demo.log").open("a", encoding="utf-8"))
            commands = Commands(log, ending)
            url = stack.enter_context(commands.server(place, out / "tokens"))
            made = [_make_cell(out, number) for number in range(1, cells + 1)]
            for cell in made:
                sender = ["fleet", "send", str(cell), "--to", url, "--token-file", str(out / "tokens")]
                sender += ["--cell", cell.name, "--simulated", "--every", f"{SEND_S:g}"]
                stack.enter_context(commands.beside(*sender))
            shown = shlex.quote(place if store is None else "URL")  # a password stays where it was typed
            ask = f"curl -H 'Authorization: Bearer {tokens.viewer}'"
            _say(
                f"robots: {ask} {url}/api/v1/robots",
                f"        truepose history robots --store {shown}",
                f"trend:  {ask} '{url}/api/v1/robots/{_serial(1)}/trend?parameter=d2'",
                "Ctrl-C ends everything; what was sent is kept, what was not waits in its outbox.",
            )
            for cell in made:
                _calibrate(cell, commands)
            _settle(made, ending)
            commands.run("fleet", "diagnose", "--store", place, "--workers", str(workers))
            while True:
                for cell in made:
                    _watch(cell, commands)
                if once:
                    _settle(made, ending)
                    break
                _say(f"the next round begins in {every:g} s")
                if ending.wait(every):
                    raise _Stopped
        except _Stopped:
            _say("ending")
            raise typer.Exit(exit_codes.INTERRUPTED) from None


def _serial(number: int) -> str:
    return f"120-{500000 + number}"


def _make_cell(out: Path, number: int) -> Path:
    """Create the folder of a cell, with cell.toml and campaign.toml."""
    folder = out / f"cell-{number}"
    effect = _EFFECTS[(number - 1) % len(_EFFECTS)]
    rehearsal.write_files(folder, number, effect, TIME_SCALE, calibration=POSES, validation=JUDGED)
    file = folder / "cell.toml"
    replace_file(
        file, read_text(file).replace("[simulation]", f'[simulation]\nserial = "{_serial(number)}"', 1)
    )
    return folder


def _calibrate(cell: Path, commands: Commands) -> None:
    """Measure a campaign, identify its model and choose check poses, if there is no model yet."""
    if (cell / "watch.toml").exists():
        return
    record = cell / f"campaign-{new_id()}"
    parts = [str(cell / name) for name in ("cell.toml", "campaign.toml")]
    commands.run("campaign", "run", *parts, "--record", str(record), "--simulate")
    data, model = str(record / "data.csv"), str(cell / "model.json")
    commands.run("campaign", "export", str(record), data)
    commands.run("diagnose", data, "--model", model, "--json", str(cell / "diagnosis.json"))
    plan = ["watch", "plan", model, parts[0], "--poses", "8", "--candidates", "200"]
    commands.run(*plan, "--out", str(cell / "watch.toml"))


def _watch(cell: Path, commands: Commands) -> None:
    """Measure the check poses and judge them."""
    record = cell / f"watch-{new_id()}"
    files = [str(cell / name) for name in ("model.json", "cell.toml", "watch.toml")]
    told = ["--record", str(record), "--simulate", "--json", f"{record}.json"]
    verdicts = (exit_codes.DONE, exit_codes.NOT_MET, exit_codes.UNKNOWN_CAUSE)
    commands.run("watch", "run", *files, *told, good=verdicts)


def _settle(cells: Sequence[Path], ending: ShutdownSignal) -> None:
    """Wait until nothing waits in any outbox."""
    from fleet.outbox import FILE, Outbox

    seen_twice = 0
    while seen_twice < 2:  # the sender has looked again since the last file was written
        if ending.wait(2.0 * SEND_S):
            raise _Stopped
        counts = []
        for cell in cells:
            with Outbox(cell / FILE) as outbox:
                counts.append(len(outbox.entries("waiting")))
        seen_twice = 0 if any(counts) else seen_twice + 1


# -- processes --------------------------------------------------------------------------------------------


class Commands:
    """Commands of this program, each below a guard.

    A guard ends when its standard input closes, and therefore also when this program is killed. `log` takes the
    output of the commands; `ending` tells when to stop.
    """

    def __init__(self, log: IO[str], ending: ShutdownSignal) -> None:
        self.ending = ending
        self._log = log

    def run(self, *arguments: str, good: Sequence[int] = (exit_codes.DONE,)) -> None:
        """Run one to its end. Raises _Stopped, typer.Exit with its code where that is none of `good`."""
        with self.beside(*arguments) as process:
            while (code := process.poll()) is None:
                if self.ending.wait(0.1):
                    raise _Stopped
        if code not in good:
            self._failed(f"it ended with exit code {code}")
            raise typer.Exit(code)

    @contextmanager
    def beside(self, *arguments: str, told: bool = False) -> Iterator[subprocess.Popen[str]]:
        """Run a command concurrently until the block ends.

        Its standard output is read if `told` is set.
        """
        line = shlex.join(["truepose", *arguments])
        _say(line)
        self._log.write(f"$ {line}\n")
        self._log.flush()
        command = python("service.guard", *python("truepose", *arguments))
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE if told else self._log,
            stderr=self._log,
            encoding="utf-8",
            start_new_session=True,  # Ctrl-C is for the demo
        )
        try:
            yield process
        finally:
            _end(process)

    @contextmanager
    def server(self, store: str, tokens: Path) -> Iterator[str]:
        """Run the fleet's server and return its address.

        Raises
        ------
        typer.Exit
            It does not start.
        """
        arguments = ("fleet", "serve", "--store", store, "--token-file", str(tokens), "--json")
        with self.beside(*arguments, told=True) as process:
            assert process.stdout is not None
            hello = process.stdout.readline()
            if not hello:
                self._failed("it did not start")
                raise typer.Exit(exit_codes.FAILED)
            yield notation.loads(hello)["url"]

    def _failed(self, what: str) -> None:
        """Report a failed command, with the last line of the log."""
        self._log.flush()
        last = Path(self._log.name).read_text(encoding="utf-8").strip().splitlines()[-1:]
        _say(f"{what}: {' '.join(last)}", f"more is in {self._log.name}")


def _end(process: subprocess.Popen[str]) -> None:
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
    try:
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _say(*lines: str) -> None:
    for line in lines:
        sys.stderr.write(f"fleet: {line}\n")
    sys.stderr.flush()
