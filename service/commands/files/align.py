"""`truepose align`: synchronise two streams of a moving robot.

The intervals in which the robot is stationary become a data set.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from calib.arm import built_in_robots
from calib.data import read_dataset
from calib.motion import SLOW_MM_S
from calib.text import replace_file
from service.commands import options
from service.files import STANDARD_OUTPUT
from service.printed import alignment_tables
from service.printed.terminal import Terminal
from service.results.files import alignment
from service.results.files.alignment_request import HOLDOUT, SEED, AlignmentRequest
from service.results.shape import document_of


def align_command(
    robot_stream: Annotated[
        Path,
        typer.Argument(
            metavar="ROBOT.csv",
            help="Recording of the robot: columns t_s, j1_deg, ..., or an RTDE recording.",
        ),
    ],
    tracker_stream: Annotated[
        Path,
        typer.Argument(
            metavar="TRACKER.csv",
            help="Recording of the tracker: columns t_s, x_mm, y_mm, z_mm, and status for lost points.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT.csv",
            help="File for the data set; its header OUT.toml is written to the same folder.",
        ),
    ],
    robot: Annotated[str, typer.Option(metavar="NAME|FILE.toml", help="Built-in robot or robot file.")],
    tool: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="X Y Z", help="Nominal position of the measured point in the flange frame, mm."),
    ],
    tool_known: Annotated[
        bool, typer.Option("--tool-known", help="Take the position of --tool as exact; do not fit it.")
    ] = False,
    slower_than: Annotated[
        float,
        typer.Option(metavar="MM/S", help="Speed of the tool below which a sample counts as at rest, mm/s."),
    ] = SLOW_MM_S,
    robot_columns: Annotated[
        str | None,
        typer.Option(
            metavar="MAP",
            help="Columns of ROBOT.csv if their names differ: 'time=Timestamp[ms], j1=axis 1[rad], ...'.",
        ),
    ] = None,
    tracker_columns: Annotated[
        str | None,
        typer.Option(
            metavar="MAP",
            help="Columns of TRACKER.csv if their names differ, as for --robot-columns. 'spatial-analyzer[mm]' reads "
            "the export of points with time stamps.",
        ),
    ] = None,
    coupling: Annotated[
        str,
        typer.Option(
            help="Name of the joint matrix by which the controller counts its joints, as joint_coupling in a header."
        ),
    ] = "none",
    instrument: Annotated[str, typer.Option(help="Name of the instrument, for the header.")] = "unknown",
    sigma: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="Standard uncertainty of the instrument per coordinate, mm, the least for every row. Default: "
            "[noise] of TRACKER.toml, or 0.05.",
        ),
    ] = None,
    every_sample: Annotated[
        bool,
        typer.Option(
            "--every-sample", help="Write a row for each sample at rest, not one per stationary interval."
        ),
    ] = False,
    holdout: Annotated[
        float,
        typer.Option(metavar="SHARE", help="Share of the waypoints held out for validation; 0 for none."),
    ] = HOLDOUT,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the random choice of the held-out waypoints.")
    ] = SEED,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.svg",
            help="File for a picture: the speeds of robot and tracker before and after the alignment of "
            "their clocks, and the error by speed.",
        ),
    ] = None,
    json: options.Json = None,
) -> None:
    """Align the streams of a moving robot and of a tracker. The stationary intervals become a data set."""
    inputs = (robot_stream, tracker_stream, tracker_stream.with_suffix(".toml"), Path(robot))
    options.check_data_set(out, json, inputs, picture=picture)
    order = AlignmentRequest(
        tool=tool,
        robot=robot,
        robot_in_header=_beside(out, robot),
        tool_known=tool_known,
        slower_than=slower_than,
        coupling=coupling,
        instrument=instrument,
        sigma_mm=sigma,
        robot_columns=robot_columns,
        tracker_columns=tracker_columns,
        every_sample=every_sample,
        holdout=holdout,
        seed=seed,
    )
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        result = alignment.aligned_of(robot_stream, tracker_stream, order, terminal.say)
        terminal.say(f"writing {out}")
        result.table.write(out)
        read_dataset(out)  # refused now, by name, rather than by the command that comes next
        described = alignment.AlignmentResult.of(result)
        options.write_result(document_of(described), json, terminal)
        if picture is not None:
            # drawing is not needed for the numbers, and takes long to import
            from service.report.figures.motion import motion_picture

            terminal.say("drawing the picture")
            replace_file(picture, motion_picture(result))
        terminal.rest()
        for shown in alignment_tables.aligned(described):
            terminal.out.print(shown)
        terminal.note(f"data set: {out}")
        if picture is not None:
            terminal.note(f"picture: {picture}")


def _beside(out: Path, robot: str) -> str:
    """Return the robot as a header in the folder of `out` names it.

    Files are found relative to that folder.
    """
    if robot in built_in_robots():
        return robot
    try:
        return Path(os.path.relpath(robot, out.parent)).as_posix()
    except ValueError:  # on another drive
        return str(Path(robot).resolve())
