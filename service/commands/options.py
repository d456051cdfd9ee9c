"""Options that several commands share, and what they check."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calib.errors import DataError

Data = Annotated[
    Path, typer.Argument(metavar="DATA.csv", help="Data set; its header DATA.toml stands beside it.")
]
Json = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE|-", help="Write the result for programs; '-' is standard output."),
]
Report = Annotated[
    Path | None, typer.Option("--report", metavar="report.html", help="Write a report that stands by itself.")
]
Model = Annotated[
    Path | None,
    typer.Option("--model", metavar="M.json", help="Save the model, to predict and correct with."),
]


def refuse_missing_folders(*paths: Path | str | None) -> None:
    """Raise DataError for an output whose folder does not exist: told before the work, not after it."""
    for path in paths:
        if path is not None and str(path) != "-" and not Path(path).absolute().parent.is_dir():
            raise DataError(
                "cannot be written: its folder does not exist.", do="Make the folder first.", file=path
            )
