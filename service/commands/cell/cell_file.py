"""`truepose cell`: the cell file."""

from __future__ import annotations

from typing import Annotated

import typer

from acquisition import Cell
from acquisition.file_table import FileSchema
from service.commands import options
from service.files import STANDARD_OUTPUT, write_json

app = typer.Typer(help="Write the JSON schema of cell files.")


@app.command("schema")
def schema_command(
    out: Annotated[
        str, typer.Argument(metavar="OUT.json|-", help="File to write; '-' is standard output.")
    ] = STANDARD_OUTPUT,
) -> None:
    """Write the JSON schema of cell files, with which editors complete and check them."""
    options.check_outputs({"OUT": out})
    write_json(Cell.model_json_schema(schema_generator=FileSchema), out)
