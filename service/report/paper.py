"""The marks of a report that can be filed and signed: its number, who measured and when, program and hashes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import metadata
from importlib.resources import files
from pathlib import Path
from typing import Any

from calib.data import Dataset
from service.report.scope import devices_of

_ROOMS = ("service", "acquisition", "drivers", "calib")
_DIGITS = 12
_MISSING = "not recorded in the data set"
_OF_THE_RUN = ("seconds",)  # keys of a result that differ each time it is worked out


def number_of(document: Mapping[str, Any], program: str) -> str:
    """The number of a report, "TP-1a2b-3c4d-5e6f", from its result and the hash of the program: the same readings and
    the same program give the same number."""
    rest = {key: value for key, value in document.items() if key not in _OF_THE_RUN}
    text = json.dumps([program, rest], sort_keys=True, separators=(",", ":"), allow_nan=False)
    digits = hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]
    return "-".join(("TP", *(digits[i : i + 4] for i in range(0, _DIGITS, 4))))


def hash_of(folders: Iterable[Path]) -> str:
    """SHA-256 of the sources in folders: the names and bytes of their Python files and templates, in order."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(p for p in folder.rglob("*") if p.suffix in (".py", ".j2", ".toml")):
            digest.update(f"{folder.name}/{path.relative_to(folder).as_posix()}\0".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


@cache
def program_hash() -> str:
    """SHA-256 of the program that runs."""
    return hash_of(Path(str(files(room))) for room in _ROOMS)


def paper_of(dataset: Dataset, document: Mapping[str, Any], model_sha256: str | None) -> dict[str, Any]:
    """The number of the report and its lines (what, value, whether the value is a hash). model_sha256: of the saved
    model, None where there is none."""
    program = program_hash()
    return {
        "number": number_of(document, program),
        "lines": [
            *((what, how, False) for what, how in (*_measured(dataset), *_devices(dataset))),
            ("Program", f"TruePose {metadata.version('truepose')}", False),
            ("SHA-256 of the program", program, True),
            ("SHA-256 of the data set with its header", dataset.sha256, True),
            (
                "SHA-256 of the model (content_sha256 of its file)",
                model_sha256 or "none: the fit did not converge",
                model_sha256 is not None,
            ),
        ],
    }


def _devices(dataset: Dataset) -> list[tuple[str, str]]:
    return devices_of(dataset) or [("Serial numbers", _MISSING)]


def _merged(campaigns: int) -> str:
    return f", {campaigns} campaigns merged" if campaigns > 1 else ""


def _measured(dataset: Dataset) -> list[tuple[str, str]]:
    occasion = dataset.header.occasion
    if occasion is None:
        return [("Measured", _MISSING), ("Operators", _MISSING)]
    return [
        ("Measured", f"{occasion.began} to {occasion.ended}{_merged(occasion.campaigns)}"),
        ("Operators", ", ".join(occasion.operators) or _MISSING),
    ]
