"""`truepose convert`: a foreign file becomes a data set, with a share of its rows held out."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from calib.convert import IMPORTERS
from calib.errors import DataError
from service import wording
from service.commands import options
from service.files import STANDARD_OUTPUT, write_json
from service.printed.terminal import Terminal


class HoldoutKind(Enum):
    """How rows are held out."""

    RANDOM = "random"
    BLOCK = "block"


def convert(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The foreign file.")],
    out: Annotated[
        Path, typer.Argument(metavar="OUT.csv", help="The data set; OUT.toml is written beside it.")
    ],
    source: Annotated[
        str, typer.Option("--from", metavar="NAME", help=f"What it is: {', '.join(sorted(IMPORTERS))}.")
    ],
    holdout: Annotated[
        HoldoutKind | None,
        typer.Option(help="Hold rows out for validation: drawn one by one, or whole blocks of time."),
    ] = None,
    share: Annotated[float, typer.Option(help="Share of the rows held out.")] = 0.2,
    seed: Annotated[int, typer.Option(help="Draws the rows held out.")] = 1,
    json: options.Json = None,
) -> None:
    """Import foreign data."""
    if source not in IMPORTERS:
        raise DataError(
            f"'{source}' is not a known kind of file.",
            do=f"Use {', '.join(sorted(IMPORTERS))}.",
            key="--from",
        )
    if out.suffix != ".csv":
        raise DataError("is not the name of a data set.", do="Let it end in .csv.", file=out)
    if not file.is_file():
        raise DataError("there is no such file.", do="Check the name.", file=file)
    data, header = options.files_of(out)
    options.check_outputs({"OUT.csv": data, "header of OUT.csv": header, "--json": json}, inputs=(file,))
    with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
        terminal.say(f"reading {file}")
        table = IMPORTERS[source](file)
        if holdout is not None:
            table = table.hold_out(holdout.value, share, seed)
        terminal.say(f"writing {out}")
        table.write(out)
        terminal.rest()
        held = table.columns.get("set", []).count("validation")
        terminal.out.print(
            f"{out}: {wording.counted(len(table), 'reading')}, {held} of them held out for validation."
        )
    write_json(
        {
            "format": "truepose-conversion/1",
            "data": str(out),
            "header": str(out.with_suffix(".toml")),
            "readings": len(table),
            "validation": held,
            "holdout": None if holdout is None else holdout.value,
        },
        json,
    )
