"""Options that several commands share, with their checks."""

from __future__ import annotations

import math
import os
import stat
import sys
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from calib.compensate import Bounds, Usable
from calib.errors import DataError
from calib.prior import TypePrior, load_prior
from calib.saved import CalibratedModel, load_model
from calib.text import DATA_SETS, PARQUET, note_files
from service import exit_codes, written
from service.files import STANDARD_OUTPUT, write_json
from service.printed.terminal import Terminal
from service.results.judgement.acceptance import NAMES, AcceptanceLimits, AcceptanceResult, read_zones

Data = Annotated[
    Path,
    typer.Argument(metavar="DATA.csv", help="Data set; its header DATA.toml must be in the same folder."),
]
Json = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE|-", help="File for the result as JSON; '-' is standard output."),
]
Report = Annotated[
    Path | None, typer.Option("--report", metavar="report.html", help="File for the report (HTML).")
]
Model = Annotated[
    Path | None,
    typer.Option(
        "--model", metavar="M.json", help="File for the model, with which other commands predict and correct."
    ),
]
Level = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=3,
        help="Parameters to fit: 1 for joint zeros and scales, 2 for all geometry, 3 for geometry and "
        "compliance under gravity. Default: as [model] in DATA.toml.",
    ),
]
PriorFile = Annotated[
    Path | None,
    typer.Option(
        "--prior",
        metavar="PRIOR.json",
        help="Prior of the robot type: mean and spread of its parameters, from 'truepose fleet learn'.",
    ),
]
SaveAnyway = Annotated[
    bool,
    typer.Option(
        "--save-anyway",
        help="Save the model even if it misses held-out readings by more than the nominal robot does.",
    ),
]
AcceptRms = Annotated[
    float | None,
    typer.Option(
        "--accept-rms",
        metavar="MM",
        help="Required RMS error on validation rows, mm, judged with its uncertainty. Exit code 3 if it is not met.",
    ),
]
AcceptMax = Annotated[
    float | None,
    typer.Option(
        "--accept-max",
        metavar="MM",
        help="Required largest error on validation rows, mm, judged with its uncertainty. Exit code 3 if "
        "it is not met.",
    ),
]
AcceptZones = Annotated[
    Path | None,
    typer.Option(
        "--accept-zones",
        metavar="ZONES.toml",
        help="File of boxes in the base frame, each with its own limits. Exit code 3 if one is not met.",
    ),
]
RobotFile = Annotated[
    Path | None,
    typer.Option("--robot", metavar="FILE.toml", help="Robot file with which the model must agree."),
]
LargestCorrection = Annotated[
    tuple[float, float],
    typer.Option(
        metavar="DEG MM",
        help="Largest permitted turn and shift of the flange by the model, deg and mm; a larger one is refused.",
    ),
]
CellName = Annotated[
    str | None,
    typer.Option("--cell", metavar="NAME", help="Name of the cell (default: the name of this computer)."),
]
Serial = Annotated[
    str, typer.Option(metavar="SERIAL", help="Serial number of the robot, if its controller reports none.")
]
NamedOnly = Annotated[
    bool,
    typer.Option("--named-only", help="Leave out the carried terms of the model: correct named causes only."),
]
_WRITING = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH
LARGEST = (Bounds().turn_deg, Bounds().shift_mm)


def limits_of(rms: float | None, largest: float | None, zones: Path | None) -> AcceptanceLimits | None:
    """Return the limits of --accept-rms, --accept-max and --accept-zones; None without any.

    Raises
    ------
    DataError
        A limit or the file of zones cannot be used.
    """
    return AcceptanceLimits.of(rms, largest, () if zones is None else read_zones(zones))


def read_model(path: Path, robot_file: Path | None, largest: tuple[float, float]) -> CalibratedModel:
    """Read a model file for a command.

    Raises
    ------
    DataError
        The model cannot be used; the message names file, key or option.
    """
    if not all(0.0 < value < math.inf for value in largest):
        raise DataError(
            "must be two numbers above zero.",
            do="Give the largest turn in deg and the largest shift in mm: DEG MM.",
            key="--largest-correction",
        )
    return load_model(path, robot_file=robot_file, bounds=Bounds(*largest))


def read_for_use(
    path: Path, robot_file: Path | None, largest: tuple[float, float], *, named_only: bool
) -> tuple[CalibratedModel, Usable]:
    """Read a model file for corrections, and list the parts of the model that are left out.

    Raises
    ------
    DataError
        The model cannot be used.
    """
    saved = read_model(path, robot_file, largest)
    return saved.for_use(named_only=named_only, bounds=Bounds(*largest))


def read_prior(path: Path | None) -> TypePrior | None:
    """Read the prior of --prior; None without the option.

    Raises
    ------
    DataError
        The prior cannot be used.
    """
    return None if path is None else load_prior(path)


def note_without_regression(saved: CalibratedModel, terminal: Terminal) -> None:
    """Tell the user that a command leaves out the regression of a model, if it has one."""
    if saved.regression is not None:
        terminal.note("truepose: the regression in the model is left out: only compensate uses it")


def check_outputs(
    outputs: Mapping[str, Path | str | None],
    *,
    inputs: Iterable[Path | None] = (),
    added_to: Collection[str] = (),
) -> None:
    """Refuse outputs that cannot be written or would overwrite something, before the work.

    A file that no command has written (`service.written`) is refused unless --overwrite is given.

    Parameters
    ----------
    outputs : mapping of str to path
        File of each option or argument.
    inputs : iterable of path
        Files that are read.
    added_to : collection of str
        Options of files that keep their content.

    Raises
    ------
    DataError
        An output is refused; the message names the option.
    """
    note_files(written.remember)
    read = [path for path in inputs if path is not None]
    taken: dict[str, str] = {}
    places: dict[str, tuple[Path, str]] = {}
    for option, path in outputs.items():
        if path is None or (option == "--json" and path == STANDARD_OUTPUT):
            continue
        if not str(path).strip():
            raise DataError("is empty.", do="Name a file.", file=option)
        shown = f"{option} {path}"
        place = _place(Path(path), shown)
        if place.is_dir():
            raise DataError("is a folder.", do="Name a file.", file=shown)
        if not place.parent.is_dir():
            raise DataError(
                "cannot be written: its folder does not exist.", do="Make the folder first.", file=shown
            )
        if place.exists() and not place.is_file():
            raise DataError("is not an ordinary file.", do="Name another file.", file=shown)
        if place.exists() and option not in added_to and not place.stat().st_mode & _WRITING:
            raise DataError(
                "is write-protected.", do="Name another file, or make it writable first.", file=shown
            )
        if not os.access(place.parent, os.W_OK):  # rather now than after the work
            raise DataError(
                "cannot be written: you may not write into its folder.", do="Name another folder.", file=shown
            )
        for each in read:
            if _same(place, _place(each, str(each))):
                raise DataError(
                    f"would be written over {each}, which is read.", do="Name another file.", file=shown
                )
        key = os.path.normcase(place)
        if key in taken:
            raise DataError(f"is the same file as {taken[key]}.", do="Name another file.", file=shown)
        taken[key] = option
        places[option] = (place, shown)
    for option, (
        place,
        shown,
    ) in places.items():  # after all others: no option writes over a file that is read
        writer = f"{written.command} {option}"
        written.intend(place, writer, added_to=option in added_to)
        if not place.exists() or option in added_to or (found := written.writer_of(place)) in ("", writer):
            continue
        if not written.overwriting:
            by = "was not written by truepose, or has been changed since"
            raise DataError(
                f"is there already, and {by if found is None else f'was written by {found}'}.",
                do="Name another file, or add --overwrite to replace it.",
                file=shown,
            )
        sys.stderr.write(f"truepose: {shown} is replaced; it was not written by this command as it is now\n")


def check_data_set(out: Path, json: str | None, inputs: Iterable[Path | None], **others: Path | None) -> None:
    """Refuse a file that is no data set or that, like its header, cannot be written.

    `others` are outputs of further options by name.

    Raises
    ------
    DataError
        `out` ends in neither .csv nor .parquet, or it or its header cannot be written.
    ModuleNotFoundError
        It is Parquet, and its extra is not installed.
    """
    if out.suffix not in DATA_SETS:
        raise DataError("is not the name of a data set.", do="Let it end in .csv or .parquet.", file=out)
    if out.suffix == PARQUET:
        import pyarrow  # noqa: F401 - rather now than after the work
    data, header = files_of(out)
    kind = f"OUT{out.suffix}"
    more = {f"--{name}": path for name, path in others.items()}
    check_outputs({kind: data, f"header of {kind}": header, "--json": json, **more}, inputs=inputs)


def write_result(document: Mapping[str, Any], json: str | None, terminal: Terminal) -> None:
    """Write the JSON first of all results, with the spinner out."""
    if json == STANDARD_OUTPUT:
        terminal.rest()
    write_json(document, json)
    terminal.begin("writing")


def finish(acceptance: AcceptanceResult | None, terminal: Terminal) -> None:
    """End a command by its acceptance. Raises typer.Exit with NOT_MET for a verdict other than accepted."""
    if acceptance is not None and acceptance.verdict != "accepted":
        terminal.note(f"truepose: {NAMES[acceptance.verdict].lower()}: {' '.join(acceptance.sentences)}")
        raise typer.Exit(exit_codes.NOT_MET)


def files_of(data: Path | None) -> tuple[Path, ...]:
    """Return a data set's files: the CSV and its header."""
    return () if data is None or not data.name else (data, data.with_suffix(".toml"))


def _place(path: Path, shown: str) -> Path:
    """Return the file itself, at the end of its symlinks."""
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:  # links that lead back to themselves
        raise DataError("leads nowhere.", do="Name another file.", file=shown) from error


def _same(one: Path, other: Path) -> bool:
    if os.path.normcase(one) == os.path.normcase(other):
        return True
    return one.exists() and other.exists() and one.samefile(other)
