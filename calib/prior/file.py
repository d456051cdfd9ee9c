"""`PRIOR.json`: statistics of a robot type on disk (`truepose-prior/1`).

The file contains

- for every parameter mean, spread, their standard uncertainties, and the standard deviation of a further robot;
- the hashes of the models it was learned from, and the robots outside the type;
- effects with the number of robots in which they were found;
- the version of the program, and a hash of the whole file.

A prior of another version is refused. A prior with a spread of zero is refused too, because it would decide a parameter
before anything was measured.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import DataError
from calib.fit.least_squares import DroppedParameter
from calib.fit.type_prior import TypeEffect, TypeParameter, TypePrior
from calib.prior.type_statistics import FEWEST, TypeStatistics
from calib.saved.model_checks import content_hash, dropped_of
from calib.text import read_json, replace_file
from calib.units import FACTORS

FORMAT = "truepose-prior/1"
_AGAIN = "Learn it again with 'truepose fleet learn MODEL... --out PRIOR.json'."


def program_version() -> str:
    """Return the version of this program."""
    return metadata.version("truepose")


def prior_document(lesson: TypeStatistics) -> dict[str, Any]:
    """Build the document of type statistics, with its `content_sha256`."""
    prior = lesson.prior()
    document: dict[str, Any] = {
        "format": FORMAT,
        "program": program_version(),
        "robot": prior.robot,
        "robot_sha256": prior.robot_sha256,
        "joint_coupling": prior.coupling,
        "simulated": lesson.members[0].saved.simulated,
        "groups": list(lesson.groups),
        "robots": len(lesson.members),
        "models": [{"name": m.name, "content_sha256": m.sha256} for m in lesson.members],
        "parameters": [asdict(p) | {"kept": p.kept} for p in lesson.parameters],
        "redundant": [
            {"name": d.name, "stand_ins": [[name, move] for name, move in d.stand_ins]}
            for d in lesson.redundant
        ],
        "found": [{"label": f.label, "shape": dict(f.shape), "robots": f.robots} for f in lesson.found],
        "outliers": [asdict(o) for o in lesson.outliers],
        "left_out": [{"model": name, "because": reason} for name, reason in lesson.left_out],
    }
    document["content_sha256"] = content_hash(document)
    return document


def save_prior(path: Path, lesson: TypeStatistics) -> None:
    """Write type statistics to a file.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    replace_file(path, json.dumps(prior_document(lesson), indent=1, allow_nan=False) + "\n")


def load_prior(path: Path) -> TypePrior:
    """Read a prior.

    Raises
    ------
    DataError
        This version cannot use the prior; the message names file and key.
    """
    document = read_json(path)
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise DataError(
            "is not the prior of a type.",
            do=f'It must hold "format": "{FORMAT}". {_AGAIN}',
            file=path,
            key="format",
        )
    if document.get("program") != program_version():
        raise DataError(
            f"was learnt by version {document.get('program')!r}, this is {program_version()!r}.",
            do=_AGAIN,
            file=path,
            key="program",
        )
    if document.get("content_sha256") != content_hash(document):
        raise DataError("was changed after it was written.", do=_AGAIN, file=path, key="content_sha256")
    try:
        return _prior(document, path)
    except KeyError as error:
        raise DataError("is missing.", do=_AGAIN, file=path, key=str(error.args[0])) from error
    except (TypeError, AttributeError, ValueError) as error:
        if isinstance(error, DataError):
            raise
        raise DataError(f"is damaged ({error}).", do=_AGAIN, file=path) from error


def _prior(document: Mapping[str, Any], path: Path) -> TypePrior:
    robots = _count(document["robots"], "robots", path)
    if robots < FEWEST:
        raise DataError(f"is {robots}, fewer than {FEWEST}.", do=_AGAIN, file=path, key="robots")
    shares: dict[str, TypeParameter] = {}
    for entry in document["parameters"]:
        share = _share(entry, path)
        if share.name in shares:
            raise DataError("is given twice.", do=_AGAIN, file=path, key=f"parameters.{share.name}")
        if entry["kept"]:
            shares[share.name] = share
    redundant: tuple[DroppedParameter, ...] = dropped_of(document["redundant"], path)
    return TypePrior(
        robot=str(document["robot"]),
        robot_sha256=str(document["robot_sha256"]),
        coupling=str(document["joint_coupling"]),
        groups=tuple(str(group) for group in document["groups"]),
        shares=shares,
        redundant=redundant,
        found=tuple(
            TypeEffect(str(f["label"]), dict(f["shape"]), _count(f["robots"], f"found.{f['label']}", path))
            for f in document["found"]
        ),
        robots=robots,
        sha256=str(document["content_sha256"]),
    )


def _share(entry: Mapping[str, Any], path: Path) -> TypeParameter:
    name, unit, centre, spread = (entry[key] for key in ("name", "unit", "mean", "of_next"))
    key = f"parameters.{name}"
    if unit not in FACTORS:
        raise DataError(f"is in the unit {unit!r}.", do=_AGAIN, file=path, key=key)
    for what, value in (("mean", centre), ("of_next", spread)):
        if not isinstance(value, int | float) or isinstance(value, bool) or not np.isfinite(value):
            raise DataError(
                f"is {value!r}, but a finite number is needed.", do=_AGAIN, file=path, key=f"{key}.{what}"
            )
    if spread <= 0.0:
        raise DataError(
            f"is {spread:g}, but the spread between robots must be above 0.",
            do=_AGAIN,
            file=path,
            key=f"{key}.of_next",
        )
    return TypeParameter(str(name), unit, float(centre), float(spread))


def _count(value: Any, key: str, path: Path) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise DataError(
            f"is {value!r}, but a whole number of robots, 0 or more, is needed.",
            do=_AGAIN,
            file=path,
            key=key,
        )
    return value
