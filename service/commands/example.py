"""`truepose example`: the files of the tutorial *Get started*."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calib.text import replace_file
from service.commands import options

FILES = Path(__file__).parents[1] / "example"


def example_command(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Existing folder for the files.")] = Path(),
) -> None:
    """Write the example files of Get started: simulated readings and two targets."""
    files = {folder / file.name: file.read_text("utf-8") for file in sorted(FILES.iterdir())}
    options.check_outputs({path.name: path for path in files})
    for path, text in files.items():
        replace_file(path, text)
        typer.echo(path)
