"""`truepose verify`: the proof of a saved model on the robot of a cell.

New poses are driven with the corrections of the model and without, by the same code as the verification of
`truepose calibrate`. DIR has the records of the campaigns and `result.json`. The same command again continues a
verification that was interrupted.
"""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from acquisition import read_cell
from acquisition.errors import RecordError
from acquisition.loop import VERIFICATION, clock_of, plan_of_proof, prove, usable_here
from acquisition.record import RecordStore, is_begun
from calib.errors import DataError
from calib.text import replace_file
from service.commands import options
from service.commands.cell.calibrate import at_the_cell, refuse_torn, resumable
from service.files import STANDARD_OUTPUT, write_json
from service.job_folder import MODEL, RESULT
from service.printed import tables
from service.printed.terminal import Terminal
from service.private import note_if_others_read, owner_only
from service.results.cell.proven import FILES, write_proof


@owner_only()
def verify_command(
    cell: Annotated[Path, typer.Argument(metavar="CELL.toml", help="Cell file.")],
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="Model to verify.")],
    poses: Annotated[
        int,
        typer.Option(
            metavar="N", min=1, max=500, help="Number of new poses, each driven corrected and uncorrected."
        ),
    ] = VERIFICATION,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random poses.")] = 1,
    record: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for records and result. Default: CELL-verification."),
    ] = None,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Start the cell's simulators and drive them, not the robot.")
    ] = False,
    plan_only: Annotated[
        bool, typer.Option("--plan-only", help="Check the model and every pose, and end.")
    ] = False,
    robot: options.RobotFile = None,
    json: options.Json = None,
) -> None:
    """Verify a model on the robot. Repeat the command to continue an interrupted verification."""
    options.check_outputs({"--json": json}, inputs=(cell, model))
    the_cell = read_cell(cell)
    folder = record or Path(f"{the_cell.name}-verification")
    with ExitStack() as stack:
        terminal = stack.enter_context(Terminal(quiet=json == STANDARD_OUTPUT))
        saved = usable_here(
            the_cell, options.read_model(model, robot, options.LARGEST), model, simulated=simulate
        )
        since_s = clock_of(saved, time.time(), the_cell.time_scale if simulate else 1.0)
        plan = plan_of_proof(the_cell, saved, poses, seed, since_s)
        terminal.rest()
        terminal.out.print(f"{plan.in_words()}.", soft_wrap=True)
        if plan_only:
            return
        going_on = _check_folder(folder, the_cell.source, model, simulate=simulate)
        motion = "continues the verification in" if going_on else f"drives {poses} new poses; records are in"
        equipment = stack.enter_context(
            at_the_cell(
                the_cell, folder, terminal, f"{motion} {folder}", simulate=simulate, route="verifications"
            )
        )
        with resumable(terminal, "" if record else f" in {folder}"):
            if not going_on:
                replace_file(folder / MODEL, model.read_text("utf-8"))
            targets, found = prove(equipment, saved, folder, poses=poses, seed=seed, say=terminal.say)
            document = write_proof(targets, found, saved, folder, simulate)
        terminal.rest()
        from service.report.sections import verification  # drawing takes long to import

        driven = {"driven uncorrected": found.uncorrected, "driven corrected": found.verified}
        terminal.out.print(tables.errors(driven, "new poses on the robot"))
        terminal.out.print(f"On the robot: {verification.scope_in_words(found)}", soft_wrap=True)
        terminal.out.print(verification.floor_in_words(found), soft_wrap=True)
        terminal.out.print(f"Every reading with its error and U: {folder / RESULT}", soft_wrap=True)
        write_json(document, json)


def _check_folder(folder: Path, cell: str, model: Path, *, simulate: bool) -> bool:
    """Return whether the folder has this verification, interrupted.

    Raises
    ------
    RecordError
        It has another verification, a part of one, or one that is finished.
    DataError
        It is a file, or has files of others that the verification would replace.
    """
    if folder.exists() and not folder.is_dir():
        raise DataError("is a file.", do="Name a new folder.", file=f"--record {folder}")
    if not folder.absolute().parent.is_dir():
        raise DataError("has no folder above it.", do="Make that first.", file=f"--record {folder}")
    begun = is_begun(folder / "campaign1")
    if begun:
        _check_begun(folder, cell, model, simulate=simulate)
    else:
        refuse_torn(folder)
    if folder.exists():
        options.check_outputs({name: folder / name for name in FILES if not begun or name != MODEL})
    return begun


def _check_begun(folder: Path, cell: str, model: Path, *, simulate: bool) -> None:
    """Check that a verification that was begun is this one, unfinished.

    Raises
    ------
    RecordError
        It is another one, or finished.
    """
    note_if_others_read(folder / "campaign1")
    with RecordStore.reading(folder / "campaign1") as store:
        row = store.campaign
    if (folder / RESULT).is_file():
        raise RecordError(
            f"{folder}: holds a finished verification",
            what_to_do="Give a new folder with --record to verify again.",
        )
    same = (folder / MODEL).is_file() and (folder / MODEL).read_bytes() == model.read_bytes()
    if not same or row["cell"] != cell or bool(row["simulated"]) != simulate:
        raise RecordError(
            f"{folder}: was begun with another cell, another model, or with other devices",
            what_to_do="Give the files and options with which it was begun to continue it, or "
            "a new folder with --record.",
        )
