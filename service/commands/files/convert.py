"""`truepose convert`: create a data set from a foreign file.

A known file is read by its importer, any other by a map of its columns.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from calib.convert import IMPORTERS
from calib.errors import DataError
from service.commands import options
from service.commands.files.own_files import OwnFiles
from service.files import STANDARD_OUTPUT, write_json
from service.printed.terminal import Terminal
from service.results.files.conversion import ConversionResult
from service.results.shape import document_of


class HoldoutKind(Enum):
    """Ways of holding out poses."""

    RANDOM = "random"
    BLOCK = "block"
    NONE = "none"


def convert(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE [FILE2]",
            help="Foreign file, or one with joints and one with points. With --from, the foreign file and OUT.csv.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="OUT.csv",
            help="File for the data set; its header OUT.toml is written to the same folder.",
        ),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="NAME", help=f"Known kind of the foreign file: {', '.join(sorted(IMPORTERS))}."
        ),
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map", metavar="MAP.toml", help="Map of the columns of the files. Default: a map is proposed."
        ),
    ] = None,
    propose: Annotated[
        Path | None,
        typer.Option(metavar="MAP.toml", help="File for the proposed map; nothing is converted yet."),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.toml", help="Robot that was measured: a built-in robot or a robot file."
        ),
    ] = None,
    answer: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=CHOICE", help="Answer to a question of the proposal; may be repeated."),
    ] = None,
    sigma: Annotated[
        float | None,
        typer.Option(
            min=1e-6, metavar="MM", help="Standard deviation of one measured coordinate, mm; 0.05 is assumed."
        ),
    ] = None,
    instrument: Annotated[str | None, typer.Option(help="Name of the instrument, for the header.")] = None,
    lines: Annotated[
        tuple[int, int] | None,
        typer.Option(metavar="FIRST LAST", help="First and last line of the table, if a file holds several."),
    ] = None,
    holdout: Annotated[
        HoldoutKind | None,
        typer.Option(
            help="Poses held out for validation: drawn at random, whole blocks of consecutive poses, or "
            "none. Without "
            "it random, and blocks along a path."
        ),
    ] = None,
    share: Annotated[
        float | None, typer.Option(help="Share of the poses held out, 0 to 1; 0.2 is assumed.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of the random choice of the held-out poses; 1 is assumed.")
    ] = None,
    json: options.Json = None,
) -> None:
    """Convert measurements of another program into a data set."""
    given = {"kind": None if holdout is None else holdout.value, "share": share, "seed": seed}
    given = {key: value for key, value in given.items() if value is not None}
    if source is not None:
        if map_file or propose or robot or answer or lines or sigma or instrument:
            raise DataError(
                "reads a known kind of file and takes neither a map nor answers.",
                do="Leave them out.",
                file="--from",
            )
        _known(files, out, source, given, json)
        return
    own = OwnFiles(files, out, map_file, propose, robot, answer or [], sigma, instrument, lines)
    own.convert(given, json)


def _known(
    files: list[Path], out: Path | None, source: str, holdout: Mapping[str, Any], json: str | None
) -> None:
    """Return a file that an importer knows."""
    if source not in IMPORTERS:
        raise DataError(
            f"'{source}' is not a known kind of file.",
            do=f"Use {', '.join(sorted(IMPORTERS))}.",
            key="--from",
        )
    if out is None and len(files) == 2:
        files, out = files[:1], files[1]
    if out is None or len(files) != 1:
        raise DataError("takes one file.", do="Give FILE OUT.csv.", file=f"--from {source}")
    file = files[0]
    options.check_data_set(out, json, (file,))
    if not file.is_file():
        raise DataError("there is no such file.", do="Check the name.", file=file)
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {file}")
        table = IMPORTERS[source](file).hold_out(**holdout)
        terminal.say(f"writing {out}")
        table.write(out)
        terminal.rest()
        result = ConversionResult.of(out, table)
        terminal.out.print(result.summary)
    write_json(document_of(result), json)
