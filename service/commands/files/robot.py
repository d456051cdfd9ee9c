"""`truepose robot`: robot files are written, imported, checked, listed and shown."""

from __future__ import annotations

import json as notation
import sys
from enum import Enum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from calib.arm import Robot, built_in_robots, load_robot
from calib.array import Array
from calib.errors import DataError
from calib.robot_file import (
    SCHEMA,
    Described,
    Draft,
    described,
    held_against,
    import_dh,
    import_urdf,
    read_handful,
    weighed,
    written_robot,
)
from calib.text import read_text, replace_file
from service import exit_codes
from service.commands import options
from service.commands.files.robot_answers import RobotFileAnswers, ask_draft, ask_mass
from service.files import STANDARD_OUTPUT, write_json
from service.printed.robot_tables import (
    described_lines,
    document_of,
    link_table,
    posture_table,
    verdict_document,
    verdict_lines,
)
from service.printed.terminal import Terminal
from service.report.figures.arm_picture import arm_svg

app = typer.Typer(help="Write, import and check the file of a robot of your own.")


class ConventionName(Enum):
    """Conventions of DH tables."""

    DH = "dh"
    MDH = "mdh"


class AngleUnit(Enum):
    """Units of angles."""

    DEG = "deg"
    RAD = "rad"


class LengthUnit(Enum):
    """Units of lengths."""

    MM = "mm"
    M = "m"


RobotArgument = Annotated[str, typer.Argument(metavar="NAME|FILE.toml", help="Built-in robot or robot file.")]
ConventionOption = Annotated[
    ConventionName | None,
    typer.Option(help="Convention of the DH table: standard (dh) or modified (mdh, Craig)."),
]

MassOption = Annotated[
    float | None,
    typer.Option(
        min=0.001,
        metavar="KG",
        help="Mass of the whole arm, kg, from which the masses of the links are estimated and written. Only if the "
        "masses of the links are not given.",
    ),
]


@app.command("new")
def new_command(
    out: Annotated[Path, typer.Argument(metavar="OUT.toml", help="Robot file to write.")],
    name: Annotated[str | None, typer.Option(help="Name of the robot.")] = None,
    maker: Annotated[str | None, typer.Option(help="Maker of the robot.")] = None,
    convention: ConventionOption = None,
    joints: Annotated[int | None, typer.Option(min=1, max=20, help="Number of joints.")] = None,
    link: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NUMBERS",
            help="Row of the DH table: alpha deg, a mm, theta deg, d mm, lowest, highest, with 'slides' "
            "before them for "
            "a joint that slides. One --link per joint.",
        ),
    ] = None,
    source: Annotated[str | None, typer.Option(help="Source of the numbers, such as a manual.")] = None,
    mass: MassOption = None,
) -> None:
    """Write a robot file. Missing options are requested at the terminal."""
    _refuse_existing(out)
    convention_name = None if convention is None else convention.value
    asked = RobotFileAnswers(name, maker, convention_name, joints, link or [], source, mass)
    draft = ask_draft(asked)
    written_robot(draft)
    _write(draft, out)


@app.command("import")
def import_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="URDF file, or CSV table of DH numbers.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="OUT.toml",
            help="Robot file to write. Default: FILE.toml in the current folder.",
        ),
    ] = None,
    convention: ConventionOption = None,
    base: Annotated[
        str | None,
        typer.Option(
            metavar="LINK", help="URDF: name of the link that is the base. Default: the outermost link."
        ),
    ] = None,
    tip: Annotated[
        str | None,
        typer.Option(
            metavar="LINK",
            help="URDF: name of the link that is the flange. Default: the only end of the tree.",
        ),
    ] = None,
    angles: Annotated[
        AngleUnit | None, typer.Option(help="CSV: unit of the angles, if the table does not show it.")
    ] = None,
    lengths: Annotated[
        LengthUnit | None,
        typer.Option(help="CSV: unit of the lengths, where nothing shows it, or of an arm as large as none."),
    ] = None,
    limits: Annotated[
        AngleUnit | None,
        typer.Option(help="CSV: unit of the limits of joints that turn, where the numbers contradict it."),
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Name of the robot. Default: the name in the file.")
    ] = None,
    maker: Annotated[str, typer.Option(help="Maker of the robot.")] = "unknown",
    mass: MassOption = None,
) -> None:
    """Make a robot file from a URDF or a table of DH numbers."""
    out = Path(f"{file.stem}.toml") if out is None else out
    _refuse_existing(out)
    with Terminal() as terminal:
        if file.suffix.lower() in (".urdf", ".xml", ".xacro"):
            _refuse_of_table(
                {"--convention": convention, "--angles": angles, "--lengths": lengths, "--limits": limits}
            )
            found = import_urdf(file, base=base, tip=tip, name=name, maker=maker)
            draft, remarks = found.draft, found.remarks
            terminal.note(
                f"truepose: the chain of the robot file and that of the URDF differ by at most "
                f"{found.off_mm:.1g} mm and {found.off_rad:.1g} rad in 200 random postures"
            )
        else:
            _refuse_of_urdf({"--base": base, "--tip": tip})
            draft, _, remarks = import_dh(
                file,
                None if convention is None else convention.value,
                angles=None if angles is None else angles.value,
                lengths=None if lengths is None else lengths.value,
                limits=None if limits is None else limits.value,
                name=name,
                maker=maker,
            )
        for remark in remarks:
            terminal.note(f"truepose: {remark}")
    if mass is None and not draft.loads and sys.stdin.isatty():
        mass = ask_mass()
    _write(weighed(draft, mass) if mass else draft, out)


@app.command("check")
def check_command(
    robot: RobotArgument,
    data: Annotated[
        Path | None,
        typer.Argument(
            metavar="[DATA.csv]", help="Data set of some 20 readings: joints and measured points."
        ),
    ] = None,
    home: Annotated[
        str | None,
        typer.Option(metavar="J1,J2,...", help="Joint angles of a posture to show too, deg or mm."),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", metavar="OUT.svg", help="File for a picture of the arm.")
    ] = None,
    posture: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Posture of the picture: 'zero', 'middle' or 'home'. Default: home, or zero if the robot "
            "file has no home.",
        ),
    ] = None,
    json: options.Json = None,
) -> None:
    """Check a robot file, also with readings that reveal usual mistakes.

    Shows the flange in named postures, reach, wrist, inverse kinematics and oddities, and draws the arm. Exit code
    3 if the readings show a mistake, or if nothing explains them.
    """
    path = Path(robot)
    options.check_outputs({"--picture": picture, "--json": json}, inputs=(path, *options.files_of(data)))
    found = load_robot(robot)
    at_home = None if home is None else _posture(home, found)
    about = described(found, at_home)
    verdict = None
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        if data is not None:
            terminal.say(f"holding {robot} against {data}")
            text = read_text(path) if path.is_file() else ""
            verdict = held_against(path, text, read_handful(found, data))
        terminal.rest()
        terminal.out.print(link_table(found))
        terminal.out.print(posture_table(found, about))
        for line in (*described_lines(about), *(() if verdict is None else verdict_lines(verdict))):
            terminal.out.print(line, soft_wrap=True)
        if picture is not None:
            name = _drawn(posture, about)
            replace_file(picture, arm_svg(found, about.postures[name][0], f"{found.name}, {name}"))
            terminal.note(f"picture: {picture}")
    document = document_of(found, about)
    write_json(document if verdict is None else document | {"readings": verdict_document(verdict)}, json)
    if verdict is not None and not verdict.explained:
        raise typer.Exit(exit_codes.NOT_MET)


@app.command("list")
def list_command(json: options.Json = None) -> None:
    """List the robots that are built in, with their source."""
    robots = [load_robot(name) for name in built_in_robots()]
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.rest()
        for robot in robots:
            terminal.out.print(
                f"{robot.name:<24} {robot.maker}, {robot.joints} joints. {robot.source}", soft_wrap=True
            )
    write_json({"robots": [document_of(robot) for robot in robots]}, json)


@app.command("show")
def show_command(robot: RobotArgument, json: options.Json = None) -> None:
    """Show the table of a robot, its limits and its source."""
    found = load_robot(robot)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.rest()
        terminal.out.print(f"{found.name}, {found.maker}, {found.convention}")
        terminal.out.print(link_table(found))
        terminal.out.print(f"Source: {found.source}", soft_wrap=True)
    write_json(document_of(found), json)


@app.command("schema")
def schema_command() -> None:
    """Print the JSON schema of robot files."""
    typer.echo(notation.dumps(SCHEMA, indent=1))


def _refuse_existing(out: Path) -> None:
    if out.suffix != ".toml":
        raise DataError("is not the name of a robot file.", do="Let it end in .toml.", file=out)
    options.check_outputs({"robot file": out})
    if out.exists():
        raise DataError("exists already.", do="Name another file, or move it away.", file=out)


def _posture(text: str, robot: Robot) -> Array:
    """Parse the joints of a posture, shape (N,), rad or mm.

    Raises
    ------
    DataError
        The text is not one number per joint.
    """
    try:
        counted = np.array([float(word) for word in text.replace(";", ",").split(",")])
    except ValueError:
        counted = np.array([])
    if len(counted) != robot.joints or not np.all(np.isfinite(counted)):
        names = ", ".join(robot.joint_columns)
        raise DataError(f"is '{text}'.", do=f"Give {robot.joints} numbers: {names}.", key="--home")
    return counted * robot.joint_units


def _drawn(posture: str | None, about: Described) -> str:
    names = {"zero": "all zero", "middle": "middle of the ranges", "home": "home"}
    name = (
        names.get(posture, "")
        if posture is not None
        else ("home" if "home" in about.postures else "all zero")
    )
    if name not in about.postures:
        raise DataError(f"is '{posture}'.", do="Say zero, middle, or home with --home.", key="--posture")
    return name


def _refuse_of_table(given: dict[str, object]) -> None:
    for option, value in given.items():
        if value is not None:
            raise DataError("applies to DH tables only.", do="Leave it out; a URDF states it.", key=option)


def _refuse_of_urdf(given: dict[str, object]) -> None:
    for option, value in given.items():
        if value is not None:
            raise DataError(
                "applies to URDFs only.", do="Leave it out; a table has no links by name.", key=option
            )


def _write(draft: Draft, out: Path) -> None:
    replace_file(out, draft.text)
    if draft.loads_estimated:
        typer.echo(
            f"truepose: the masses in {out} are estimates; replace them if the maker publishes some", err=True
        )
    elif not draft.loads:
        typer.echo(
            f"truepose: no masses are known, so gravity is not modelled: a real arm of 0.6 m reach was then off by "
            f"0.31 instead of 0.11 mm, and no gear, play or stiffness is named. Give the mass of the arm with "
            f"--mass KG, or write [[loads]] into {out}",
            err=True,
        )
    typer.echo(f"truepose: {out} is written; now: truepose robot check {out}", err=True)
