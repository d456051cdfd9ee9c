"""`truepose demo`: the whole loop on a simulated cell with a hidden effect.

The cell runs in a separate process and speaks the devices' wire protocols over real sockets, so that nothing of
the hidden robot can leak into the program. The robot is measured and diagnosed. If something is ambiguous,
poses that settle it are measured as well. Then the robot gets corrected targets and is measured again. The
hidden effect is requested from the simulator's back door afterwards, to be shown next to the result. `--narrow`
starts so that effects stay ambiguous. `--in-memory` leaves out devices and correction: it makes a simulated
campaign as files, and its diagnosis.
"""

from __future__ import annotations

import json as json_module
import shutil
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from acquisition import ScaledClock, pausing_on_interrupt, read_status
from acquisition.loop import Equipment, LoopEnded, LoopResult, close_loop, rehearsal
from calib.data import read_dataset
from calib.diagnose import DiagnosisFit
from calib.errors import DataError
from calib.text import replace_file
from service import exit_codes, written
from service.child import python
from service.commands import options
from service.commands.models.diagnose import show, write_results
from service.files import STANDARD_OUTPUT, write_json
from service.printed import tables
from service.printed.looped import show_loop
from service.printed.progress import RunProgress
from service.printed.terminal import Terminal
from service.private import owner_only
from service.results.cell import loop_results
from service.results.models.diagnosed import DiagnosisOutcome, DiagnosisRequest
from service.results.models.predictions import predictions_csv
from service.simulated_cell import simulated_cell

# What a demo writes into its folder
FILES = (
    "cell.toml",
    "campaign.toml",
    "data.csv",
    "data.toml",
    "data1.csv",
    "data1.toml",
    "data_follow_up.csv",
    "data_follow_up.toml",
    "diagnosis.json",
    "model.json",
    "predictions.csv",
    "report.html",
    "targets.csv",
    "truth.json",
    "wire_abb.log",
    "wire_faro.log",
)
_MARKS = {"truth.json", "wire_abb.log"}  # of a folder in which a demo has run
SIMULATION_TIMEOUT_S, BACK_DOOR_TIMEOUT_S = 120.0, 10.0


@owner_only()
def demo(
    seed: Annotated[
        int, typer.Option(help="Seed of the random robot, its errors and the hidden effect.")
    ] = 1,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for data, records, results and report.")
    ] = Path("demo-out"),
    time_scale: Annotated[
        float, typer.Option(min=1.0, max=1000.0, help="Simulated seconds per real second.")
    ] = rehearsal.TIME_SCALE,
    effect: Annotated[
        str | None,
        typer.Option(
            metavar="LABEL",
            help="Effect to hide in the robot, e.g. backlash:j4. Default: one drawn from the seed.",
        ),
    ] = None,
    narrow: Annotated[
        bool,
        typer.Option(
            "--narrow",
            help="Measure the middle of the joint ranges first, where effects look alike, e.g. with "
            "--effect periodic:j5:n2: the loop then measures poses that distinguish them.",
        ),
    ] = False,
    in_memory: Annotated[
        bool,
        typer.Option(
            "--in-memory",
            help="Only diagnose a simulated data set, without simulated devices and correction.",
        ),
    ] = False,
    json: options.Json = None,
) -> None:
    """See the loop on a simulated robot with an undeclared effect."""
    if out.exists() and not out.is_dir():
        raise DataError("is not a folder.", do="Name a folder.", file=f"--out {out}")
    options.check_outputs({"--json": json}, inputs=[out / name for name in FILES])
    theirs = [name for name in FILES if (out / name).exists()]
    changed = [name for name in theirs if written.changed_since(out / name)]
    if not _MARKS.intersection(theirs):
        changed = theirs
    if changed and not written.overwriting:
        raise DataError(
            f"holds {changed[0]}, which no demo has written, or which has been changed since.",
            do="Name another folder, or add --overwrite to replace it.",
            file=f"--out {out}",
        )
    if not out.absolute().parent.is_dir():
        raise DataError(
            "cannot be made: the folder above it does not exist.", do="Make it first.", file=f"--out {out}"
        )
    if narrow and in_memory:
        raise DataError(
            "needs the devices, --in-memory leaves them out.", do="Leave out one of the two.", file="--narrow"
        )
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        if in_memory:
            document, hidden = _in_memory(seed, out, effect, terminal)
        else:
            document, hidden = _on_the_cell(seed, out, effect, time_scale, narrow, terminal)
    write_json({**document, "hidden": [each["label"] for each in hidden]}, json)


def _on_the_cell(
    seed: int, out: Path, effect: str | None, time_scale: float, narrow: bool, terminal: Terminal
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    _clear(out)
    cell, campaign = rehearsal.write_files(out, seed, effect, time_scale, narrow=narrow)
    terminal.say("starting the simulated cell: an ABB IRB 120 and a FARO ION")
    with simulated_cell(cell) as simulated, rehearsal.wire_logs(out) as wire:
        equipment = Equipment(
            cell,
            rehearsal.open_wired(cell, simulated.ports, wire),
            ScaledClock(time_scale),
            simulated=True,
            guard=pausing_on_interrupt,
            listen=lambda run: RunProgress(run, terminal),
        )
        try:
            result = close_loop(equipment, campaign, out, say=terminal.say)
        except LoopEnded as ended:
            terminal.rest()
            error = ended.outcome.error
            terminal.note(f"truepose: the demo ended early. {ended if error is None else error.what_to_do}")
            raise typer.Exit(ended.outcome.exit_code) from ended
        hidden = _truth(simulated.ports["backdoor"])
    document = _write(result, out, terminal)
    terminal.rest()
    show_loop(result, terminal)
    _reveal(hidden, result.diagnosis, terminal)
    terminal.out.print(
        f"Open {out / 'report.html'}; beside it: diagnosis.json, predictions.csv, data.csv, model.json, "
        "targets.csv, and what went over the wires: wire_abb.log, wire_faro.log."
    )
    return document, hidden


def _write(result: LoopResult, out: Path, terminal: Terminal) -> dict[str, Any]:
    replace_file(out / "predictions.csv", predictions_csv(result.diagnosis))
    terminal.say("drawing the report")
    return loop_results.write(result, out, name="diagnosis.json")[0]


def _truth(port: int) -> list[dict[str, Any]]:
    """Read the effects that the simulated cell hides from its back door.

    Raises
    ------
    OSError
        The back door cannot be reached.
    """
    with socket.create_connection(("127.0.0.1", port), timeout=BACK_DOOR_TIMEOUT_S) as link:
        link.sendall(b'{"do": "truth"}\n')
        with link.makefile("rb") as answers:
            return json_module.loads(answers.readline())["effects"]


def _reveal(hidden: list[dict[str, Any]], diagnosis: DiagnosisFit, terminal: Terminal) -> None:
    terminal.out.print(tables.revealed(hidden, diagnosis))


def _clear(out: Path) -> None:
    """Delete the records of an earlier demo.

    Raises
    ------
    DataError
        A record there was measured on real devices.
    """
    for record in sorted(out.glob("campaign*/")):
        if not read_status(record).simulated:
            raise DataError(
                "holds a record of real measurements.", do="Choose another folder for the demo.", file=record
            )
        shutil.rmtree(record)


def _in_memory(
    seed: int, out: Path, effect: str | None, terminal: Terminal
) -> tuple[Mapping[str, Any], list[dict[str, Any]]]:
    terminal.say("measuring a simulated robot with a hidden effect")
    _simulate(seed, out, effect)
    dataset = read_dataset(out / "data.csv")
    outcome = DiagnosisOutcome.of(dataset, DiagnosisRequest(), terminal.say)
    document = outcome.document()
    write_json(document, str(out / "diagnosis.json"))
    write_results(
        outcome,
        document,
        terminal,
        predictions=out / "predictions.csv",
        report=out / "report.html",
    )
    hidden = json_module.loads((out / "truth.json").read_text(encoding="utf-8"))["effects"]
    terminal.rest()
    show(outcome, terminal)
    _reveal(hidden, outcome.diagnosis, terminal)
    terminal.out.print(f"Open {out / 'report.html'}; beside it: diagnosis.json, predictions.csv, data.csv.")
    return document, hidden


def _simulate(seed: int, out: Path, effect: str | None) -> None:
    """Run the simulated campaign.

    Raises
    ------
    DataError
        It cannot write.
    typer.Exit
        It fails.
    """
    command = python("mocks.campaign", "--seed", str(seed), "--approach", "varied")
    command += ["--out", str(out)]
    if effect is not None:
        command += ["--effect", effect]
    done = subprocess.run(
        command, capture_output=True, encoding="utf-8", timeout=SIMULATION_TIMEOUT_S, check=False
    )
    if done.returncode == exit_codes.USAGE:
        raise DataError(
            done.stderr.strip() or "the simulation refused.", do="Choose another seed.", key="--seed"
        )
    if done.returncode != exit_codes.DONE:
        last = done.stderr.strip().splitlines()[-1:] or ["no message"]
        sys.stderr.write(f"truepose: the simulation failed: {last[0]}\n")
        raise typer.Exit(exit_codes.FAILED)
