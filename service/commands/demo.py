"""`truepose demo`: a simulated campaign with an effect hidden in it, diagnosed without knowing which.

The simulation runs in a process of its own and hands over files alone, as a foreign laboratory would: nothing of
the hidden robot can leak into the program. What was hidden is read afterwards, to be shown beside what was found.
"""

from __future__ import annotations

import json as json_module
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from calib.dataset import read_dataset
from calib.diagnose.diagnosis import diagnose
from calib.errors import DataError
from service import documents, exit_codes, tables
from service.commands import options
from service.commands.diagnose import show, write_results
from service.files import STANDARD_OUTPUT, write_json
from service.terminal import Terminal

SIMULATION_TIMEOUT_S = 120.0


def demo(
    seed: Annotated[int, typer.Option(help="Draws the robot, its errors and the hidden effect.")] = 1,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for data, results and report.")] = Path(
        "demo-out"
    ),
    json: options.Json = None,
) -> None:
    """See the whole loop on a simulated robot with an undeclared effect."""
    options.refuse_missing_folders(out, json)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say("measuring a simulated robot with a hidden effect")
        _simulate(seed, out)
        dataset = read_dataset(out / "data.csv")
        diagnosis = diagnose(dataset, progress=terminal.say)
        document = documents.of_diagnosis(diagnosis) | {"simulated": True}
        write_results(
            diagnosis,
            document,
            terminal,
            predictions=out / "predictions.csv",
            report=out / "report.html",
            simulated=True,
        )
        write_json(document, str(out / "diagnosis.json"))
        hidden = json_module.loads((out / "truth.json").read_text(encoding="utf-8"))["effects"]
        terminal.rest()
        show(diagnosis, terminal)
        terminal.out.print(tables.revealed(hidden, diagnosis))
        terminal.out.print(
            f"Open {out / 'report.html'}; beside it: diagnosis.json, predictions.csv, data.csv."
        )
    write_json({**document, "hidden": _labels(hidden)}, json)


def _simulate(seed: int, out: Path) -> None:
    """Run the simulated campaign. Raises DataError when it cannot write, typer.Exit when it fails."""
    command = [sys.executable, "-m", "mocks.campaign", "--seed", str(seed), "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SIMULATION_TIMEOUT_S, check=False)
    if done.returncode == exit_codes.USAGE:
        raise DataError(
            done.stderr.strip() or "the simulation refused.", do="Choose another seed.", key="--seed"
        )
    if done.returncode != exit_codes.DONE:
        last = done.stderr.strip().splitlines()[-1:] or ["no message"]
        sys.stderr.write(f"truepose: the simulation failed: {last[0]}\n")
        raise typer.Exit(exit_codes.FAILED)


def _labels(hidden: list[dict[str, Any]]) -> list[str]:
    return [effect["label"] for effect in hidden]
