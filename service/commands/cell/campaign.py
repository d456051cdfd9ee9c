"""`truepose campaign`: measure, go on after a pause, look, export. The record in DIR is the state.

`truepose campaign rescue`: save what can be read of a damaged record.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

import acquisition
from acquisition import (
    Campaign,
    Cell,
    ExecutionOutcome,
    Run,
    RunStatus,
    pausing_on_interrupt,
    read_campaign,
    read_cell,
    read_status,
)
from acquisition.campaign import CampaignTable, left_out
from acquisition.cell import unstated_in_words
from acquisition.errors import RecordError, RecordInUse, UnsafePlan
from acquisition.examination import note_low_priority
from acquisition.file_table import FileSchema
from acquisition.record import FILE as RECORD_FILE
from acquisition.record import DeviceAcceptance, RecordStore, export_streams, export_together, rescue
from acquisition.run import at_once
from calib.data import assumed_in_words, read_dataset
from calib.errors import DataError
from drivers.errors import AcquisitionError, ConfigError, NoOperator
from service import exit_codes, wording
from service.commands import options
from service.commands.cell.beside import beside
from service.files import STANDARD_OUTPUT, write_json
from service.json_values import finite
from service.printed.progress import RunProgress, terminal_operator
from service.printed.terminal import Terminal
from service.private import note_if_others_read, owner_only
from service.results.common import DataShown
from service.results.models import positions
from service.results.shape import document_of
from service.simulated_cell import simulated_cell


def rescue_command(
    record: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the damaged record.")],
    out: Annotated[
        Path | None,
        typer.Argument(
            metavar="OUT",
            help="New folder for the saved record, or OUT.csv for a data set. Default: DIR-rescued.",
        ),
    ] = None,
    json: options.Json = None,
) -> None:
    """Save the readable part of a damaged record into a new one.

    Losses are reported. DIR is left as it is.
    """
    place = out or record.with_name(f"{record.absolute().name}-rescued")
    written = options.files_of(place) if place.suffix == ".csv" else ()
    outputs = {"--json": json} | {f"OUT {file.suffix}": file for file in written}
    options.check_outputs(outputs, inputs=(record / RECORD_FILE,))
    rescued = rescue(record, place)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.rest()
        terminal.out.print(
            f"{place}: {rescued.saved} of {wording.counted(rescued.measured, 'reading')} saved.",
            soft_wrap=True,
        )
        for sentence in rescued.lost or ("Nothing was lost.",):
            terminal.note(sentence)
        if place.suffix != ".csv":
            terminal.note(f"Next: truepose campaign status {place}")
    named = {"format": "truepose-rescue/1", "record": str(record), "out": str(place)}
    write_json(named | asdict(rescued), json)


app = typer.Typer(help="Measure with a robot and an instrument. The record survives crashes and power cuts.")


@app.callback()
def _every_command(context: typer.Context) -> None:
    context.with_resource(owner_only())


Simulate = Annotated[
    bool,
    typer.Option(
        "--simulate", help="Start the cell's simulators and measure with them, not with the devices."
    ),
]

Record = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the record.")]

app.command("rescue")(rescue_command)

AcceptOther = Annotated[
    str,
    typer.Option(
        "--accept-device",
        "--accept-other",
        metavar="SERIAL",
        help="Continue with this other robot or instrument: its serial number, or its model if it reports none.",
    ),
]

Reason = Annotated[
    str,
    typer.Option(metavar="TEXT", help="Reason why the other device is accepted; it is kept in the record."),
]


@app.command("run")
def run_command(
    cell: Annotated[Path, typer.Argument(metavar="CELL.toml", help="Cell file.")],
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="Campaign file.")],
    record: Annotated[
        Path, typer.Option("--record", metavar="DIR", help="New folder for the durable record.")
    ],
    simulate: Simulate = False,
    json: options.Json = None,
) -> None:
    """Measure a campaign. Every pose is checked before the first motion."""
    options.check_outputs({"--json": json}, inputs=(cell, campaign))
    the_cell, the_campaign = read_cell(cell), read_campaign(campaign)
    if record.exists() and not record.is_dir():
        raise ConfigError(f"--record {record}: is a file", what_to_do="Name a new folder.")
    _refuse_begun(record, the_cell, the_campaign)
    with created(record, the_cell, the_campaign, campaign, simulate=simulate) as run:
        execute(run, record, json, simulate=simulate)


@app.command("resume")
def resume_command(
    record: Record,
    simulate: Simulate = False,
    accept_other: AcceptOther = "",
    reason: Reason = "",
    json: options.Json = None,
) -> None:
    """Continue a campaign after a pause, a stop or a power cut."""
    accepted = _accepted(accept_other, reason)
    options.check_outputs({"--json": json}, inputs=(record / RECORD_FILE,))
    was_simulated = read_status(record).simulated
    if was_simulated != simulate:
        made = "on simulated devices" if was_simulated else "on real devices"
        do = "Add --simulate." if was_simulated else "Leave --simulate out, or start a new record."
        raise ConfigError(
            f"{record}: was measured {made}, and both do not belong into one record", what_to_do=do
        )
    note_if_others_read(record)
    with Run.open(record) as run:
        if run.status().state != "ready":  # one that never began needs no permission to go on
            run.resume(by="terminal", accepted=accepted)
        execute(run, record, json, simulate=simulate)


@contextmanager
def _at_rest(record: Path, otherwise: str) -> Iterator[Run]:
    """Open the run of a record; `otherwise` is what to do while another program executes it."""
    try:
        run = Run.open(record)
    except RecordInUse as error:
        raise RecordInUse(error.message, what_to_do=otherwise) from error
    with run:
        yield run


@app.command("restation", hidden=True)  # the name before 0.1
@app.command("move-instrument")
def restation_command(
    record: Record,
    reason: Annotated[str, typer.Option(metavar="TEXT", help="Reason; it is kept in the record.")] = "",
    json: options.Json = None,
) -> None:
    """State that the instrument is being moved.

    The campaign pauses, and measures the nests when it is resumed.
    """
    options.check_outputs({"--json": json}, inputs=(record / RECORD_FILE,))
    with _at_rest(
        record,
        "Press Ctrl-C there, which pauses it; move the instrument, then resume: that measures the nests "
        "first. A run of 'truepose serve' takes POST /runs/{id}/restation instead.",
    ) as run:
        run.restation(by="terminal", reason=reason)
        status = run.status()
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.rest()
        terminal.out.print(f"{status.name}: noted. The nests are measured before the next pose.")
        if status.state in ("paused", "stopped"):
            terminal.note(_how_to_go_on(record, simulate=status.simulated))
    write_json(_document(record, status), json)


@app.command("finish")
def finish_command(
    record: Record,
    reason: Annotated[str, typer.Option(metavar="TEXT", help="Reason; it is kept in the record.")] = "",
    json: options.Json = None,
) -> None:
    """End a paused campaign as succeeded, with the readings that it has. A finished campaign cannot be resumed."""
    options.check_outputs({"--json": json}, inputs=(record / RECORD_FILE,))
    with _at_rest(
        record,
        "Press Ctrl-C there, which pauses it, then finish it. A run of 'truepose serve' takes "
        "POST /runs/{id}/finish instead.",
    ) as run:
        run.finish(by="terminal", reason=reason)
        status = run.status()
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.rest()
        terminal.out.print(in_words(status), soft_wrap=True)
        terminal.note(f"Next: truepose campaign export {record} OUT.csv")
    write_json(_document(record, status), json)


@app.command("status")
def status_command(record: Record, json: options.Json = None) -> None:
    """Show the progress of a campaign, also while another program runs it."""
    options.check_outputs({"--json": json}, inputs=(record / RECORD_FILE,))
    status = read_status(record)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.rest()
        terminal.out.print(in_words(status), soft_wrap=True)
    write_json(_document(record, status), json)


@app.command("schema")
def schema_command(
    out: Annotated[
        str, typer.Argument(metavar="OUT.json|-", help="File to write; '-' is standard output.")
    ] = STANDARD_OUTPUT,
) -> None:
    """Write the JSON schema of campaign files, with which editors complete and check them."""
    options.check_outputs({"OUT": out})
    write_json(CampaignTable.model_json_schema(schema_generator=FileSchema), out)


@app.command("events")
def events_command(
    record: Record,
    out: Annotated[
        Path | None,
        typer.Argument(
            metavar="OUT.jsonl",
            help="File for the events, written whole or not at all. Default: standard output.",
        ),
    ] = None,
) -> None:
    """Write the events of a campaign, one JSON object per line, the oldest first."""
    if out is not None:
        options.check_outputs({"OUT.jsonl": out}, inputs=(record / RECORD_FILE,))
        acquisition.export_events(record, out)
        return
    with TemporaryDirectory() as folder:
        file = Path(folder) / "events.jsonl"
        acquisition.export_events(record, file)
        sys.stdout.write(file.read_text(encoding="utf-8"))


@app.command("export")
def export_command(
    record: Record,
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT.csv",
            help="File for the data set; its header OUT.toml is written to the same folder.",
        ),
    ],
    later: Annotated[
        list[Path] | None,
        typer.Option(
            "--with",
            metavar="DIR",
            help="Record measured later in the same cell, such as a follow-up, to merge into the data "
            "set; may be repeated.",
        ),
    ] = None,
    accept_other: AcceptOther = "",
    reason: Reason = "",
    streams: Annotated[
        bool,
        typer.Option(
            "--streams",
            help="Write the recordings of path blocks, OUT_robot.csv and OUT_tracker.csv, and no data set.",
        ),
    ] = False,
    json: options.Json = None,
) -> None:
    """Write the readings of a record as a data set, also of an unfinished campaign."""
    accepted = _accepted(accept_other, reason)
    if streams:
        if out.suffix != ".csv":
            raise DataError("is not the name of streams.", do="Let it end in .csv.", file=out)
        if later or accepted:
            raise ConfigError(
                "--streams: goes with neither --with nor --accept-device", what_to_do="Use --streams alone."
            )
        _export_streams(record, out, json)
        return
    options.check_data_set(out, json, tuple(each / RECORD_FILE for each in (record, *(later or ()))))
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        dataset = read_dataset(
            export_together([record, *later], out, accepted) if later else acquisition.export(record, out)
        )
        terminal.rest()
        between = (
            f" and {wording.counted(len(dataset.spans), 'distance')} between balls" if dataset.spans else ""
        )
        terminal.out.print(f"{out}: {wording.counted(len(dataset), 'reading')}{between}.")
        if found := positions.by_the_bar(dataset):
            terminal.note(found)
        if assumed := assumed_in_words(dataset.header):
            terminal.note(assumed)
        if not dataset.fit_rows.any():
            terminal.note(
                f"All of them judge. Next: truepose validate {out} --model M.json --report judged.html"
            )
    write_json(
        {"format": "truepose-export/1", "record": str(record)} | document_of(DataShown.of(dataset)), json
    )


def _export_streams(record: Path, out: Path, json: str | None) -> None:
    """Export the two files of each path, and print the command that aligns them."""
    options.check_outputs({"--json": json}, inputs=(record / RECORD_FILE,))
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        cell, paths = export_streams(
            record, out, lambda files: options.check_outputs({f"OUT {file.name}": file for file in files})
        )
        terminal.rest()
        for path in paths:
            for role, file in (("robot", path.robot), ("instrument", path.tracker)):
                lost = f", {path.lost[role]} lost" if path.lost[role] else ""
                terminal.out.print(f"{file}: {wording.counted(path.samples[role], 'sample')}{lost}.")
            if not path.complete:
                terminal.note(
                    f"INCOMPLETE: the {path.name} was never driven to its end; this is its last attempt."
                )
            tool = " ".join(f"{x:g}" for x in cell.tool.targets[path.target])
            terminal.note(
                f"Next: truepose align {path.robot} {path.tracker} {path.robot.with_name('aligned.csv')} "
                f"--robot {cell.robot.model.name} --tool {tool} --instrument {cell.instrument.name}"
            )
    document = [asdict(path) | {"robot": str(path.robot), "tracker": str(path.tracker)} for path in paths]
    write_json({"format": "truepose-streams/1", "record": str(record), "paths": document}, json)


def _accepted(serial: str, reason: str) -> DeviceAcceptance | None:
    """Return the other device that the options accept.

    Raises
    ------
    ConfigError
        Only one of serial number and reason is given.
    """
    return DeviceAcceptance(serial, reason, "terminal") if serial or reason else None


def _refuse_begun(record: Path, cell: Cell, campaign: Campaign) -> None:
    """Refuse a DIR that holds a campaign, whose measurements were settled when it began.

    Raises
    ------
    RecordError
        DIR holds a campaign.
    """
    if not (record / RECORD_FILE).is_file():
        return
    store = RecordStore.open(record, writer=False)
    try:
        row = store.campaign
    finally:
        store.close()
    go_on = f"truepose campaign resume {record}{' --simulate' if row['simulated'] else ''}"
    edited = [name for name, now in (("cell", cell), ("campaign", campaign)) if row[name] != now.source]
    if edited:
        raise RecordError(
            f"{record}: was begun with another {' and another '.join(edited)} than the file says now",
            what_to_do="Give a new folder to measure what the files say. "
            f"To continue the campaign as it was begun: {go_on}",
        )
    raise RecordError(
        f"{record}: holds this campaign already",
        what_to_do=f"Continue it ({go_on}), or give a new folder to measure it again.",
    )


def created(record: Path, cell: Cell, campaign: Campaign, file: Path, *, simulate: bool) -> Run:
    """Create the run of the campaign of a file, checked before anything moves.

    Raises
    ------
    ConfigError, UnsafePlan
        The files or the plan cannot be used; the message names the campaign file.
    RecordError
        The record cannot be created.
    """
    try:
        visits = acquisition.checked_plan(cell, campaign)
        run = Run.create(record, cell, campaign, simulated=simulate, visits=visits)
    except RecordError:
        raise
    except (ConfigError, UnsafePlan) as error:  # of the plan, which does not know its file
        raise type(error)(f"{file}: {error.message}", what_to_do=error.what_to_do) from error
    note_if_others_read(record)
    for sentence in left_out(campaign, visits):
        sys.stderr.write(f"truepose: {sentence}\n")
    if cell.unstated:
        sys.stderr.write(f"truepose: {unstated_in_words(cell.unstated)}\n")
    return run


def execute(
    run: Run, record: Path, json: str | None, *, simulate: bool, quiet: bool = False, judge: str | None = None
) -> None:
    """Execute a run to its end, a pause or a stop.

    If it did not reach the end, the program exits with the contract's exit code. `judge` is the command that will
    judge the exported readings, if they are taken for one.
    """
    with ExitStack() as stack:
        terminal = stack.enter_context(Terminal(quiet=quiet or json == STANDARD_OUTPUT))
        progress = RunProgress(run, terminal)
        operator = stack.enter_context(terminal_operator())
        if simulate:
            terminal.say("starting the simulators of the cell")
            devices = stack.enter_context(simulated_cell(run.cell)).open(run.cell, operator)
        else:
            note_low_priority()
            devices = acquisition.open_devices(run.cell, operator=operator)
        stack.enter_context(
            pausing_on_interrupt(run, tell=lambda problem: terminal.note(f"truepose: NOT STOPPED: {problem}"))
        )
        adaptive = any(block.kind == "adaptive" for block in run.campaign.blocks)
        begin = stack.enter_context(beside()) if adaptive else at_once
        outcome = run.execute(devices, on_event=progress, begin=begin)
        terminal.rest()
        status = run.status()
        terminal.out.print(in_words(status), soft_wrap=True)
        if outcome.error is not None:
            terminal.note(_complaint(outcome.error, progress.prompt))
        if status.state in ("paused", "stopped"):
            terminal.note(_how_to_go_on(record, simulate=simulate))
            if judge is not None:
                terminal.note(f"Then: truepose campaign export {record} {record / 'watch.csv'}, and {judge}")
        elif status.done > status.skipped and judge is None:
            terminal.note(f"Next: truepose campaign export {record} OUT.csv")
        write_json(
            _document(record, status, outcome), json
        )  # before a late Ctrl-C is the interpreter's again
    if outcome.exit_code != exit_codes.DONE:
        raise typer.Exit(outcome.exit_code)


def _how_to_go_on(record: Path, *, simulate: bool) -> str:
    return f"Go on with: truepose campaign resume {record}{' --simulate' if simulate else ''}"


def _complaint(error: AcquisitionError, prompt: str | None) -> str:
    if isinstance(error, NoOperator) and prompt:
        return f"truepose: needs an operator: {prompt} {error.what_to_do}"
    return f"truepose: {error.sentence}"


def in_words(status: RunStatus) -> str:
    """Return one line for people."""
    parts = [
        f"{status.name}: {status.state.replace('_', ' ')}",
        f"{status.done} of {wording.counted(status.total, 'reading')}",
    ]
    if status.skipped:
        parts.append(f"{status.skipped} of them skipped")
    if status.simulated:
        parts.append("SIMULATED")
    if status.prompt is not None:
        parts.append(f"asks: {status.prompt['text']}")
    elif status.reason:
        parts.append(status.reason)
    return ", ".join(parts)


def _document(record: Path, status: RunStatus, outcome: ExecutionOutcome | None = None) -> dict[str, Any]:
    document = {"format": "truepose-run/1", "record": str(record), **finite(status.as_dict())}
    if outcome is not None:
        error = outcome.error
        document |= {"exit_code": outcome.exit_code, "error": None if error is None else error.as_dict()}
    return document
