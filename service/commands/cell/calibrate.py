"""`truepose calibrate`: from a nominal robot to a verified one, in one command.

The devices are examined, the poses chosen while they are measured until the accuracy is reached, the readings
diagnosed, and new targets driven with corrections to verify them. DIR has the records of all campaigns and the results.
The same command again continues a calibration that was interrupted. On a real cell, a person confirms at the terminal
before the first motion, and again before corrected targets are driven.
"""

from __future__ import annotations

import math
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from acquisition import (
    Campaign,
    Cell,
    Devices,
    Run,
    ScaledClock,
    open_devices,
    pausing_on_interrupt,
    read_cell,
)
from acquisition.errors import RecordError, StorageError
from acquisition.examination import examine, note_low_priority
from acquisition.loop import VERIFICATION, Equipment, LoopEnded, calibration_campaign, close_loop
from acquisition.record import RecordStore, is_begun
from calib.errors import DataError
from drivers.errors import ConfigError
from service import exit_codes
from service.commands import options
from service.commands.cell.beside import beside
from service.commands.cell.doctor import quiet_drivers, table_of
from service.commands.models.certificate import CertificateRequest, DccAbout, read_parties
from service.files import STANDARD_OUTPUT, write_json
from service.printed.looped import show_loop
from service.printed.progress import RunProgress, terminal_operator
from service.printed.terminal import Terminal
from service.private import note_if_others_read, owner_only
from service.results.cell import loop_results
from service.results.cell.accuracy import OutlookShown
from service.results.models.parameters import rows_of
from service.results.shape import document_of
from service.simulated_cell import simulated_cell
from service.wording import counted

CERTIFICATE = "certificate.xml"
_AXES = ("x", "y", "z")


@owner_only()
def calibrate_command(
    cell: Annotated[Path, typer.Argument(metavar="CELL.toml", help="Cell file.")],
    accuracy: Annotated[
        float,
        typer.Option(
            metavar="MM",
            min=0.001,
            max=100.0,
            help="RMS position error to reach in the zone, mm, with 95 % confidence.",
        ),
    ] = 0.1,
    minutes: Annotated[
        float | None,
        typer.Option(
            metavar="MIN",
            min=1.0,
            max=10_000.0,
            help="Longest time at the cell, minutes, verification included. Default: no limit.",
        ),
    ] = None,
    zone: Annotated[
        str,
        typer.Option(
            metavar="AXIS=LOW:HIGH,...",
            help="Box in the world in which the robot works, mm, e.g. x=300:550,y=-200:200. Default: the workspace.",
        ),
    ] = "",
    program: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Robot program, in a format that compensate reads; its targets are the zone."
        ),
    ] = None,
    poses: Annotated[
        int,
        typer.Option(
            metavar="N", min=1, max=500, help="Number of new poses on which the correction is verified."
        ),
    ] = VERIFICATION,
    record: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for records and results. Default: CELL-calibration."),
    ] = None,
    simulate: Annotated[
        bool,
        typer.Option("--simulate", help="Start the cell's simulators and calibrate them, not the devices."),
    ] = False,
    plan_only: Annotated[
        bool, typer.Option("--plan-only", help="Print the expected number of poses and minutes, and end.")
    ] = False,
    dcc_about: DccAbout = None,
    json: options.Json = None,
) -> None:
    """Calibrate the robot of a cell and verify it. Repeat the command to continue an interrupted calibration."""
    options.check_outputs({"--json": json}, inputs=(cell, *([program] if program is not None else [])))
    the_cell = read_cell(cell)
    folder = record or Path(f"{the_cell.name}-calibration")
    parties = read_parties(dcc_about, folder / CERTIFICATE, folder / loop_results.REPORT)
    certificate = CertificateRequest.of(folder / CERTIFICATE, parties)
    assert certificate is not None
    targets, left_out = (None, "") if program is None else _targets_of(program, the_cell)
    campaign, outlook = calibration_campaign(
        the_cell,
        accuracy_mm=accuracy,
        minutes=minutes,
        zone=_zone(zone, program),
        zone_joints_deg=targets,
        poses=poses,
    )
    with ExitStack() as stack:
        terminal = stack.enter_context(Terminal(quiet=json == STANDARD_OUTPUT))
        terminal.rest()
        terminal.out.print(outlook.in_words(), soft_wrap=True)
        if left_out:
            terminal.note(f"{program}: {left_out}")
        if plan_only:
            write_json(
                {"format": "truepose-outlook/1"} | document_of(OutlookShown.model_validate(outlook)), json
            )
            return
        going_on = _check_folder(folder, the_cell, campaign, simulate=simulate)
        motion = "continues the calibration in" if going_on else "moves to the poses; records are in"
        equipment = stack.enter_context(
            at_the_cell(the_cell, folder, terminal, f"{motion} {folder}", simulate=simulate, route="loops")
        )
        with resumable(terminal, "" if record else f" in {folder}"):
            result = close_loop(equipment, campaign, folder, poses=poses, say=terminal.say)
            terminal.say("drawing the report")
            document, sealed = loop_results.write(result, folder, parties=parties)
            parameters = [document_of(row) for row in rows_of(result.diagnosis.final)]
            certificate.write(result.diagnosis.dataset, document, parameters, sealed)
        terminal.rest()
        show_loop(result, terminal)
        terminal.out.print(
            f"Open {folder / 'report.html'}; beside it: model.json, {CERTIFICATE}, result.json, data.csv, targets.csv.",
            soft_wrap=True,
        )
        write_json(document, json)


@contextmanager
def at_the_cell(
    cell: Cell, folder: Path, terminal: Terminal, motion: str, *, simulate: bool, route: str
) -> Iterator[Equipment]:
    """Examine the devices, ask the person at the cell, and yield the equipment of a loop.

    `motion` states the request. `folder` is made for its records. `route` of the service does the same. Within the
    block a request to end is as Ctrl-C where no run hears it.

    Raises
    ------
    ConfigError
        There is no person at the terminal of a real cell.
    typer.Exit
        The examination has found a fault, or the person says no.
    """
    if not simulate and not sys.stdin.isatty():
        raise ConfigError(
            "this moves the robot, and there is no person at this terminal to confirm it",
            what_to_do=f"Start it at a terminal, or over HTTP with a lease: POST /api/v1/{route}.",
        )
    with ExitStack() as stack:
        # So simulators and worker end, and the message says how to continue.
        stack.callback(
            signal.signal, signal.SIGTERM, signal.signal(signal.SIGTERM, signal.default_int_handler)
        )
        if simulate:
            terminal.say("starting the simulators of the cell")
        simulators = stack.enter_context(simulated_cell(cell)) if simulate else None
        operator = stack.enter_context(terminal_operator())

        def devices() -> Devices:
            if simulators is not None:
                return simulators.open(cell, operator)
            return open_devices(cell, operator=operator)

        with quiet_drivers():
            found = examine(cell, devices(), record=folder, simulated=simulate, progress=terminal.say)
        terminal.rest()
        if found.exit_code != exit_codes.DONE:
            terminal.out.print(table_of(found))
            raise typer.Exit(found.exit_code)
        confirm: Callable[[str], bool] = (
            (lambda motion: True) if simulate else terminal_confirmation(terminal)
        )
        if not confirm(motion):
            terminal.note("Nothing has moved.")
            raise typer.Exit(exit_codes.INTERRUPTED)
        if not simulate:
            note_low_priority()
        folder.mkdir(exist_ok=True)
        yield Equipment(
            cell,
            devices(),
            ScaledClock(cell.time_scale if simulate else 1.0),
            simulate,
            guard=lambda run: pausing_on_interrupt(
                run, tell=lambda problem: terminal.note(f"truepose: NOT STOPPED: {problem}")
            ),
            listen=lambda run: RunProgress(run, terminal),
            create=created_or_continued,
            begin=stack.enter_context(beside()),
            confirm=confirm,
        )


@contextmanager
def resumable(terminal: Terminal, where: str) -> Iterator[None]:
    """Print how to continue if the block ends early; `where` names the folder if no option does.

    Raises
    ------
    typer.Exit
        It has ended early.
    """
    try:
        yield
    except (LoopEnded, KeyboardInterrupt, StorageError, OSError) as ended:
        terminal.rest()
        reason, exit_code = _why_it_ended(ended)
        terminal.note(f"truepose: {reason}")
        terminal.note(f"Give the same command again to continue{where}.")
        raise typer.Exit(exit_code) from ended


def _why_it_ended(ended: BaseException) -> tuple[str, int]:
    """Return the reason why a calibration or a verification rests, and the exit code."""
    if isinstance(ended, OSError):
        what_to_do = "Make room on the disk or correct its permissions."
        ended = StorageError(
            f"{ended.filename or 'a file'}: {ended.strerror or ended}", what_to_do=what_to_do
        )
    if isinstance(ended, StorageError):
        return ended.sentence, ended.exit_code
    if not isinstance(ended, LoopEnded):  # Ctrl-C where nothing moves, as in a diagnosis
        return "Interrupted; nothing moves.", exit_codes.INTERRUPTED
    outcome = ended.outcome
    return outcome.reason if outcome.error is None else outcome.error.sentence, outcome.exit_code


def _zone(text: str, program: Path | None) -> dict[str, list[float]] | None:
    """Return the box of --zone; None without one.

    Raises
    ------
    DataError
        The option cannot be read, or a program is given too.
    """
    if not text:
        return None
    if program is not None:
        raise DataError(
            "cannot be combined with --program, whose targets are the zone.",
            do="Leave one out.",
            key="--zone",
        )
    box: dict[str, list[float]] = {}
    for part in text.split(","):
        axis, equals, limits = part.strip().partition("=")
        low, colon, high = limits.partition(":")
        if f"{axis}_mm" in box:
            raise DataError(f"has {axis} twice.", do="Give the limits of each axis once.", key="--zone")
        try:
            box[f"{axis}_mm"] = [float(low), float(high)]
        except ValueError:
            equals = ""
        if not equals or not colon or axis not in _AXES or not all(map(math.isfinite, box[f"{axis}_mm"])):
            raise DataError(
                f"has {part!r}.", do="Write limits in mm like x=300:550,y=-200:200,z=100:400.", key="--zone"
            )
    return box


def _targets_of(program: Path, cell: Cell) -> tuple[list[list[float]], str]:
    """Return the joints of a program's targets, deg, and which targets are left out.

    The joints are as the cell counts them.

    Raises
    ------
    DataError
        The program cannot be read, or the robot reaches none of its targets.
    """
    from service.programs import KnownFrames, read_program
    from service.programs.postures import postures

    robot = cell.robot.model
    targets = read_program(program, robot, KnownFrames()).targets
    joints, why = postures(targets, robot, cell.robot.coupling)
    units, (low, high) = joints / robot.joint_units, np.array(cell.robot.limits_deg).T
    within = np.all((units >= low) & (units <= high), axis=1)  # NaN is outside
    reasons = [
        each or "outside limits_deg of the cell"
        for each, target, good in zip(why, targets, within.tolist(), strict=True)
        if not good and not target.empty
    ]
    if not within.any():
        reason = next(iter(reasons), "it has no target")
        raise DataError(
            f"has no target that can be the zone: {reason}.", do="Give --zone instead.", file=program
        )
    left_out = (
        f"{counted(len(reasons), 'target')} cannot be reached and are left out of the zone: {reasons[0]}."
    )
    return units[within].tolist(), left_out if reasons else ""


def _check_folder(folder: Path, cell: Cell, campaign: Campaign, *, simulate: bool) -> bool:
    """Return whether the folder has this calibration, interrupted.

    Raises
    ------
    ConfigError
        It is a file, or the folder above it does not exist.
    RecordError
        It has another calibration, a part of one, or one that is finished.
    DataError
        It has files of others that the calibration would replace.
    """
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"--record {folder}: is a file", what_to_do="Name a new folder.")
    if not folder.absolute().parent.is_dir():
        raise ConfigError(
            f"--record {folder}: the folder above it does not exist", what_to_do="Make it first."
        )
    first = folder / "campaign1"
    begun = is_begun(first)
    data = [f"{name}{ending}" for name in ("data", "data1", "data_follow_up") for ending in (".csv", ".toml")]
    if begun:
        note_if_others_read(first)
        with RecordStore.reading(first) as store:
            row = store.campaign
        if (folder / loop_results.RESULT).is_file() and (folder / CERTIFICATE).is_file():
            raise RecordError(
                f"{folder}: holds a finished calibration",
                what_to_do="Give a new folder with --record to calibrate again.",
            )
        other = [name for name, now in (("cell", cell), ("campaign", campaign)) if row[name] != now.source]
        if other or bool(row["simulated"]) != simulate:
            what = (
                "with or without --simulate" if not other else f"with another {' and another '.join(other)}"
            )
            raise RecordError(
                f"{folder}: was begun {what}",
                what_to_do="Give the options with which it was begun to continue it, or a new folder with --record.",
            )
    else:
        refuse_torn(folder)
    if folder.exists():
        options.check_outputs({name: folder / name for name in (*loop_results.FILES, CERTIFICATE, *data)})
    return begun


def refuse_torn(folder: Path) -> None:
    """Refuse a folder with later campaigns of a calibration or verification, but not the first.

    Raises
    ------
    RecordError
        It is such a folder.
    """
    if others := [each.name for each in sorted(folder.glob("campaign*")) if is_begun(each)]:
        raise RecordError(
            f"{folder}: has {others[0]} of a calibration or verification, and not the campaign1 on which it rests",
            what_to_do="Put campaign1 back, or give a new folder with --record.",
        )


def created_or_continued(record: Path, cell: Cell, campaign: Campaign, simulated: bool) -> Run:
    """Create a run of the loop in its record, or open the one that an earlier program has begun."""
    if not is_begun(record):
        return Run.create(record, cell, campaign, simulated=simulated)
    run = Run.open(record)
    if run.status().state in ("paused", "stopped"):
        run.resume(by="terminal")
    return run


def terminal_confirmation(terminal: Terminal) -> Callable[[str], bool]:
    """Return a function that asks the person at the terminal before a motion; Ctrl-C means no."""

    def confirm(motion: str) -> bool:
        terminal.rest()
        with suppress(typer.Abort):
            return typer.confirm(f"The robot {motion}. Is everybody clear of it, and may it move?", err=True)
        terminal.note("")  # the line of the question ends
        return False

    return confirm
