"""`truepose watch`: check whether a robot has changed since its calibration.

The result names the change and the recommended action.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import acquisition
from acquisition import read_campaign, read_cell
from acquisition.record import individual_of
from calib.data import read_dataset
from calib.errors import DataError
from calib.text import replace_file
from calib.watch import RATE
from service import exit_codes
from service.commands import options
from service.commands.cell import campaign as campaigns
from service.files import STANDARD_OUTPUT
from service.printed.terminal import Terminal
from service.printed.watch_tables import plan_tables, upkeep_tables, verdict_tables
from service.private import owner_only
from service.results.shape import document_of
from service.results.upkept import ThermalUpdateRequest, upkeep_result
from service.results.watch_plan import PlannedWatch, WatchPlanRequest, refuse_plan
from service.results.watched import WatchRequest, watch_result

app = typer.Typer(help="Check with a few poses whether a robot has changed.")

Baseline = Annotated[
    Path, typer.Argument(metavar="MODEL.json", help="Baseline: the model of the calibration.")
]
Rate = Annotated[
    float,
    typer.Option(
        "--false-alarms",
        min=1e-4,
        max=0.2,
        help="Share of watches of an unchanged robot that raise an alarm.",
    ),
]
HistoryFile = Annotated[
    Path | None,
    typer.Option(
        "--history",
        metavar="H.jsonl",
        help="File of earlier watches, with which this one is averaged and to which it is added.",
    ),
]
Update = Annotated[
    Path | None,
    typer.Option(
        "--update",
        metavar="OUT.json",
        help="File for the model with the change in it, written if its cause is known.",
    ),
]
NewFrame = Annotated[
    bool,
    typer.Option(
        "--new-frame",
        help="Fit the frame of the instrument again because it was moved. A moved base is then not detected.",
    ),
]
AllowMissing = Annotated[bool, typer.Option("--allow-missing", help="Judge even if check poses are missing.")]
RunningS = Annotated[
    float | None,
    typer.Option(
        "--since-cold-start-s",
        "--running-s",
        min=0.0,
        metavar="S",
        help="Seconds from the cold start to the first reading; for models that warm up.",
    ),
]


@app.command("plan")
def plan_command(
    model: Baseline,
    cell: Annotated[Path, typer.Argument(metavar="CELL.toml", help="Cell file.")],
    out: Annotated[
        Path, typer.Option("--out", metavar="CAMPAIGN.toml", help="File for the campaign of check poses.")
    ],
    poses: Annotated[int, typer.Option(min=1, help="Number of check poses.")] = 10,
    targets: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Targets measured at every pose (default: all of the cell)."),
    ] = None,
    candidates: Annotated[
        int,
        typer.Option(
            "--candidates",
            "--from",
            min=1,
            max=20_000,
            help="Number of random poses from which the check poses are chosen.",
        ),
    ] = 800,
    offset_deg: Annotated[
        float,
        typer.Option(
            "--approach-deg",
            "--offset-deg",
            min=0.1,
            max=30.0,
            help="Length of the last move of every joint to a pose, deg.",
        ),
    ] = 5.0,
    one_side: Annotated[
        bool,
        typer.Option(
            "--one-side",
            help="Approach every pose with all joints from below only: backlash is then not detected.",
        ),
    ] = False,
    rounds: Annotated[
        int | None,
        typer.Option(
            "--visits",
            min=1,
            max=20,
            help="Number of visits to each pose, alternately from opposite sides (default: the fewest "
            "that detect every cause).",
        ),
    ] = None,
    repeats: Annotated[
        int | None,
        typer.Option(
            "--readings",
            min=1,
            max=100,
            help="Number of readings of each target per visit (default: the fewest that detect every cause).",
        ),
    ] = None,
    touch: Annotated[
        str | None,
        typer.Option(
            "--touch",
            metavar="BALLS",
            help="Names of three or four balls of the cell that a person touches with one target.",
        ),
    ] = None,
    touch_mm: Annotated[
        float, typer.Option("--touch-mm", min=1e-4, max=1.0, help="Repeatability of a touch, mm.")
    ] = 0.02,
    new_frame: Annotated[
        bool,
        typer.Option(
            "--new-frame",
            help="Plan for an instrument or artefact that is set up again each time. A moved base is then "
            "not detected.",
        ),
    ] = False,
    rate: Rate = RATE,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random poses.")] = 1,
    robot: options.RobotFile = None,
    json: options.Json = None,
) -> None:
    """Choose check poses, and show their sensitivity."""
    options.check_outputs({"--out": out, "--json": json}, inputs=(model, cell))
    names = (
        None if targets is None else tuple(dict.fromkeys(n.strip() for n in targets.split(",") if n.strip()))
    )
    balls = () if touch is None else tuple(dict.fromkeys(n.strip() for n in touch.split(",") if n.strip()))
    asked = WatchPlanRequest(
        poses,
        candidates,
        names,
        offset_deg,
        not one_side,
        rate,
        seed,
        rounds,
        balls,
        touch_mm,
        not new_frame,
        repeats,
    )
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        saved = options.read_model(model, robot, options.LARGEST)
        found = PlannedWatch.of(read_cell(cell), cell, saved, model, asked, terminal.say)
        options.write_result(document_of(found.result), json, terminal)
        for path, text in found.files(out).items():
            replace_file(path, text)
        terminal.rest()
        for shown in plan_tables(found):
            terminal.out.print(shown)
        if found.driven:
            terminal.note(f"Next: truepose watch run {model} {cell} {out} --record DIR")
        else:
            terminal.note(
                f"Nothing drives to contact: touch the ball of each row of {out}, write the joints that the controller "
                f"shows, and empty its status. Then: truepose watch judge {model} {out}"
            )


@app.command("run")
def run_command(
    model: Baseline,
    cell: Annotated[Path, typer.Argument(metavar="CELL.toml", help="Cell file.")],
    campaign: Annotated[
        Path, typer.Argument(metavar="CAMPAIGN.toml", help="Campaign file of the check poses.")
    ],
    record: Annotated[
        Path, typer.Option("--record", metavar="DIR", help="New folder for the durable record.")
    ],
    simulate: campaigns.Simulate = False,
    history: HistoryFile = None,
    update: Update = None,
    rate: Rate = RATE,
    running_s: RunningS = None,
    robot: options.RobotFile = None,
    json: options.Json = None,
) -> None:
    """Measure the check poses and judge them. The readings are exported to DIR/watch.csv."""
    outputs = {"--json": json, "--history": history, "--update": update}
    options.check_outputs(outputs, inputs=(model, cell, campaign), added_to=["--history"])
    saved = options.read_model(model, robot, options.LARGEST)  # before anything moves
    the_cell, the_campaign = read_cell(cell), read_campaign(campaign)
    if saved.model.robot.name != the_cell.robot.model.name:
        raise DataError(
            f"is a model of the robot '{saved.model.robot.name}', the cell has '{the_cell.robot.model.name}'.",
            do="Give the model of this robot.",
            file=model,
            key="robot",
        )
    if record.exists():
        raise DataError(
            "exists already: each watch has its own record.",
            do="Name a new folder.",
            file=f"--record {record}",
        )
    refuse_plan(the_cell, cell, saved, model, acquisition.checked_plan(the_cell, the_campaign))
    with owner_only(), campaigns.created(record, the_cell, the_campaign, campaign, simulate=simulate) as run:
        for device in saved.devices:
            if device.get("role") == "robot" and device.get("serial"):
                run.need(individual_of(device))
        campaigns.execute(
            run,
            record,
            None,
            simulate=simulate,
            quiet=json == STANDARD_OUTPUT,
            judge=f"truepose watch judge {model} {record / 'watch.csv'}",
        )
    data = acquisition.export(record, record / "watch.csv")
    judge_command(model, data, history, update, rate, running_s=running_s, robot=robot, json=json)


@app.command("judge")
def judge_command(
    model: Baseline,
    data: options.Data,
    history: HistoryFile = None,
    update: Update = None,
    rate: Rate = RATE,
    new_frame: NewFrame = False,
    allow_missing: AllowMissing = False,
    running_s: RunningS = None,
    robot: options.RobotFile = None,
    json: options.Json = None,
) -> None:
    """Compare readings of check poses with the model of the calibration."""
    outputs = {"--json": json, "--history": history, "--update": update}
    options.check_outputs(outputs, inputs=(model, *options.files_of(data)), added_to=["--history"])
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        saved = options.read_model(model, robot, options.LARGEST)
        options.note_without_regression(saved, terminal)
        asked = WatchRequest(history, update, rate, not new_frame, allow_missing, running_s)
        found = watch_result(read_dataset(data), saved, model, asked, terminal.say)
        options.write_result(document_of(found), json, terminal)
        terminal.rest()
        for shown in verdict_tables(found):
            terminal.out.print(shown)
        if found.updated_model is not None:
            terminal.note(
                f"updated model: {update}. Correct targets again: truepose compensate {update} IN OUT"
            )
        elif update is not None and found.verdict == "unchanged":
            terminal.note(f"{update} was not written: nothing has changed.")
        elif update is None and found.verdict in ("changed", "ambiguous"):
            terminal.note("--update OUT.json writes the model with this change, where the cause is known.")
    if found.exit_code != exit_codes.DONE:
        raise typer.Exit(found.exit_code)


@app.command("upkeep", hidden=True)  # the name before 0.1
@app.command("thermal")
def upkeep_command(
    model: Baseline,
    data: options.Data,
    update: Annotated[
        Path | None,
        typer.Option(
            "--update", metavar="OUT.json", help="File for the model with updated thermal parameters."
        ),
    ] = None,
    rate: Rate = RATE,
    allow_missing: AllowMissing = False,
    running_s: RunningS = None,
    robot: options.RobotFile = None,
    json: options.Json = None,
) -> None:
    """Update the thermal parameters of a model from a few readings, between watches."""
    options.check_outputs({"--json": json, "--update": update}, inputs=(model, *options.files_of(data)))
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        saved = options.read_model(model, robot, options.LARGEST)
        options.note_without_regression(saved, terminal)
        asked = ThermalUpdateRequest(update, rate, running_s, allow_missing)
        found = upkeep_result(read_dataset(data), saved, model, asked, terminal.say)
        options.write_result(document_of(found), json, terminal)
        terminal.rest()
        for shown in upkeep_tables(found):
            terminal.out.print(shown)
        if found.thermal and update is not None:
            terminal.note(f"updated model: {update}")
    if found.exit_code != exit_codes.DONE:
        raise typer.Exit(found.exit_code)
