"""Extras: packages that only some commands need, and the sentence if one of them is missing.

A module imports such a package where it is used and catches nothing. The `ModuleNotFoundError` is a refusal
(`service.refusals`) for commands and for the service, and `named` states the extra in Python.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from service import written

_CELL = (
    *(
        "alembic",
        "cryptography",
        "fastapi",
        "fastapi_offline",
        "filelock",
        "h11",
        "prometheus_client",
        "pymodbus",
        "python_multipart",
    ),
    *("serial", "sqlalchemy", "starlette", "uvicorn"),
)
EXTRAS = {
    "cell": _CELL,
    "excel": ("openpyxl",),
    "fleet": (*_CELL, "dask", "distributed", "psycopg"),
    "mqtt": ("paho",),
    "opcua": ("asyncua",),
    "pandas": ("pandas",),
    "parquet": ("pyarrow",),
}
"""Modules that an extra installs, by its name in pyproject.toml."""


def cause(error: ModuleNotFoundError) -> str:
    """Return which package is missing."""
    return f"the package '{_package(error)}' is not installed."


def remedy(error: ModuleNotFoundError) -> str:
    """Return the command that installs the first extra with the package.

    For `truepose fleet` it is the extra `fleet`. Every installation needs a package of no extra.
    """
    found = [extra for extra, modules in EXTRAS.items() if _package(error) in modules]
    asked = written.command.rpartition(" ")[2]
    extra = asked if asked in found else next(iter(found), "")
    return f'Install it with: pip install "truepose{f"[{extra}]" if extra else ""}"'


def _package(error: ModuleNotFoundError) -> str:
    return (error.name or "").partition(".")[0]


@contextmanager
def named() -> Iterator[None]:
    """Name the extra in an error of a missing package.

    Raises
    ------
    ImportError
        A package is missing; the message states the command that installs it.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"{cause(error)} {remedy(error)}", name=error.name) from error
