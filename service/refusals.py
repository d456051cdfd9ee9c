"""Refusals: what a person can correct, read alike wherever it was refused: by data, by devices, by the record.

Numbers and devices know nothing of each other, so each room has a root error of its own (`calib.errors.DataError`,
`drivers.errors.AcquisitionError`), and both have the same three things: a cause, a remedy and a place. They differ in
what else they must say: data have a file, a line and a key; a device has its name, a code and an exit code.
"""

from __future__ import annotations

import os
import re
from typing import Any

from calib.errors import DataError
from drivers.errors import AcquisitionError
from fleet.errors import StoreGone
from service import exit_codes

Refusal = AcquisitionError | DataError
REFUSALS = (AcquisitionError, DataError)
# An absolute path; no URL, in which the slashes follow a colon, and no path of the interface
_PLACE = re.compile(r"(?<![\w:/.])(?!/(?:api|cell|loops|runs)/)(?:/|[A-Za-z]:[\\/])[^\s:'\"]+")


def sentence(refusal: Refusal) -> str:
    """Cause, place and remedy, for the person at the terminal."""
    if isinstance(refusal, DataError):
        return str(refusal)
    return refusal.sentence


def exit_code(refusal: Refusal) -> int:
    """The exit code of the command that met it."""
    if isinstance(refusal, StoreGone):
        return exit_codes.NOT_AVAILABLE
    return exit_codes.USAGE if isinstance(refusal, DataError) else refusal.exit_code


def cause(refusal: Refusal) -> str:
    """The fault and its place, without the remedy; of a file its name, never its place on the server."""
    if not isinstance(refusal, DataError):
        return without_places(refusal.message).rstrip(".") + "."
    name = "" if refusal.file is None else str(refusal.file).replace("\\", "/").rsplit("/", 1)[-1]
    line = "" if refusal.line is None else f"line {refusal.line}"
    key = "" if refusal.key is None else f"key '{refusal.key}'"
    place = ", ".join(part for part in (name, line, key) if part)
    return f"{place}: {refusal.what}" if place else refusal.what


def without_places(text: str) -> str:
    """A sentence with the names of files and their folders, but not where on this computer they lie."""

    def last_parts(found: re.Match[str]) -> str:
        parts = re.split(r"(?<=[\\/])", found[0])
        return "".join(parts[-2:]) if len(parts) > 3 else found[0]

    return _PLACE.sub(last_parts, text)


def remedy(refusal: Refusal) -> str:
    """The remedy of a refusal."""
    return refusal.do if isinstance(refusal, DataError) else refusal.what_to_do


def place(refusal: Refusal) -> dict[str, Any]:
    """The place of a refusal, for programs: line and key of a file, or device and name of the error."""
    if isinstance(refusal, DataError):
        given = (("line", refusal.line), ("key", refusal.key))
        return {name: value for name, value in given if value is not None}
    return {"device": refusal.device, "name": type(refusal).__name__}


def of_disk(error: OSError) -> AcquisitionError:
    """The refusal for a disk of the service that is full, or may not be written; of a file its name alone."""
    from acquisition.errors import StorageError  # a worker loads what its calls need

    text = f"{os.path.basename(str(error.filename or ''))}: {error.strerror or error}".removeprefix(": ")
    do = "Make room on the disk of the service or correct its permissions, then ask again."
    return StorageError(text, what_to_do=do)
