"""The store that a command asks: its address, or the file of this cell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from calib.errors import DataError

if TYPE_CHECKING:
    from fleet.store import Store  # it loads the database library, which not every command needs

VARIABLE = "TRUEPOSE_STORE"
DEFAULT = Path("truepose-record") / "history.sqlite3"  # beside what `truepose serve` keeps
_FILE = "sqlite:///"
_ADDRESS = "sqlite:///FILE or postgresql://USER@HOST/NAME"

StoreOption = Annotated[
    str | None,
    typer.Option(
        "--store",
        metavar="URL",
        envvar=VARIABLE,
        show_envvar=False,
        help=f"{_ADDRESS}; or in {VARIABLE}, which other users do not see. Default: {DEFAULT.as_posix()}.",
    ),
]
_PLANT: dict[str, Any] = {
    "metavar": "URL",
    "envvar": VARIABLE,
    "show_envvar": False,
    "help": f"{_ADDRESS}; or in {VARIABLE}, which other users do not see.",
}
StoreArgument = Annotated[str, typer.Argument(**_PLANT)]
PlantStore = Annotated[str, typer.Option("--store", **_PLANT)]


def opened(address: str | None, *, make: bool = False) -> Store:
    """The store at an address, or this cell's; `make` it where there is none. Raises DataError."""
    from fleet.store import Store

    own = f"sqlite:///{DEFAULT.absolute()}"
    if make:
        if address is None:
            DEFAULT.parent.mkdir(exist_ok=True)
    else:
        file = Path((address or own).removeprefix(_FILE))
        if (address or own).startswith(_FILE) and not file.exists():
            raise DataError(
                "there is no history here yet.",
                do="Name a store with --store URL, or begin one: truepose history add FILE...",
                file=file if address else DEFAULT,
            )
    return Store.open(address or own)
