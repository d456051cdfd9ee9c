"""Uniform access to refusals, the errors that a person can correct.

The numerical part and the drivers do not depend on each other, so each has a separate root error:
`calib.errors.DataError` and `drivers.errors.AcquisitionError`. Both have a cause, a remedy and a place. In addition, an
error of data has a file, a line and a key. An error of a device has the name of the device, a code and an exit code.
The missing package of an extra is a refusal, too (`service.extras`).
"""

from __future__ import annotations

import os
import re
from typing import Any

from calib.errors import DataError
from drivers.errors import AcquisitionError
from fleet.errors import StoreGone
from service import exit_codes, extras

Refusal = AcquisitionError | DataError | ModuleNotFoundError
REFUSALS = (AcquisitionError, DataError, ModuleNotFoundError)
# An absolute path; no URL, in which the slashes follow a colon, and no path of the interface
_PLACE = re.compile(r"(?<![\w:/.])(?!/(?:api|cell|loops|runs|verifications)/)(?:/|[A-Za-z]:[\\/])[^\s:'\"]+")


def sentence(refusal: Refusal) -> str:
    """Return cause, place and remedy as one text, for the person at the terminal."""
    if isinstance(refusal, ModuleNotFoundError):
        return f"{extras.cause(refusal)} {extras.remedy(refusal)}"
    return str(refusal) if isinstance(refusal, DataError) else refusal.sentence


def exit_code(refusal: Refusal) -> int:
    """Return the exit code of the command that ends with this refusal."""
    if isinstance(refusal, StoreGone):
        return exit_codes.NOT_AVAILABLE
    return refusal.exit_code if isinstance(refusal, AcquisitionError) else exit_codes.USAGE


def cause(refusal: Refusal) -> str:
    """Return the cause and its place, without the remedy.

    A file appears with its name only, never with its folder on the server.
    """
    if isinstance(refusal, ModuleNotFoundError):
        return extras.cause(refusal)
    if isinstance(refusal, AcquisitionError):
        return without_places(refusal.message).rstrip(".") + "."
    name = "" if refusal.file is None else str(refusal.file).replace("\\", "/").rsplit("/", 1)[-1]
    line = "" if refusal.line is None else f"line {refusal.line}"
    key = "" if refusal.key is None else f"key '{refusal.key}'"
    place = ", ".join(part for part in (name, line, key) if part)
    return f"{place}: {refusal.what}" if place else refusal.what


def without_places(text: str) -> str:
    """Shorten each path in a sentence to the file name and its folder, to hide its location."""

    def last_parts(found: re.Match[str]) -> str:
        parts = re.split(r"(?<=[\\/])", found[0])
        return "".join(parts[-2:]) if len(parts) > 3 else found[0]

    return _PLACE.sub(last_parts, text)


def remedy(refusal: Refusal) -> str:
    """Return the remedy of a refusal."""
    if isinstance(refusal, ModuleNotFoundError):
        return extras.remedy(refusal)
    return refusal.do if isinstance(refusal, DataError) else refusal.what_to_do


def place(refusal: Refusal) -> dict[str, Any]:
    """Return the place, for programs: line and key of a file, or device and class of the error."""
    if isinstance(refusal, ModuleNotFoundError):
        return {}
    if isinstance(refusal, DataError):
        given = (("line", refusal.line), ("key", refusal.key))
        return {name: value for name, value in given if value is not None}
    return {"device": refusal.device, "name": type(refusal).__name__}


def of_disk(error: OSError) -> AcquisitionError:
    """Create the refusal for a disk of the service that is full or not writable.

    A file appears with its name only.
    """
    from acquisition.errors import StorageError  # a worker loads what its calls need

    text = f"{os.path.basename(str(error.filename or ''))}: {error.strerror or error}".removeprefix(": ")
    do = "Make room on the disk of the service or correct its permissions, then ask again."
    return StorageError(text, what_to_do=do)
