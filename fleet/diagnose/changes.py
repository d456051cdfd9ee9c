"""Differences between program versions over the same data sets.

Compared are verdict, named effects and held-out error. The readings are the same, so no difference is due to chance:
all come from the program.

The identity of the program is its version and a fingerprint of the subpackages that determine a diagnosis. Two builds
may have one version, and a worker of the other one gives other results under the same key. This module does not need
numpy: a worker is asked before it loads it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

from calib.errors import DataError
from fleet.store import JobResult

WORTH = 0.01
"""Share by which the held-out error must differ to be told; sizes of effects by their standard error."""

_DECIDES = ("*.py", "*.toml")  # of calib: the numerics and the built-in robots
_DIGITS = 12


@dataclass(frozen=True)
class VersionStatement:
    """The statement of one version on a data set.

    `effects` maps each label to (size, standard error, unit). `rms` is the held-out error, mm, None without one.
    """

    verdict: str
    effects: Mapping[str, tuple[float, float, str]]
    rms: float | None


@dataclass(frozen=True)
class VersionDifference:
    """A data set with different results of two versions."""

    data: str
    name: str
    was: VersionStatement
    now: VersionStatement

    @property
    def gone(self) -> list[str]:
        """Effects that are no longer identified."""
        return [label for label in self.was.effects if label not in self.now.effects]

    @property
    def new(self) -> list[str]:
        """Effects that were not identified before."""
        return [label for label in self.now.effects if label not in self.was.effects]

    @property
    def resized(self) -> list[str]:
        """Effects whose size differs by more than its standard error."""
        both = [label for label in self.now.effects if label in self.was.effects]
        return [label for label in both if _resized(self.was.effects[label], self.now.effects[label])]

    @property
    def ratio(self) -> float | None:
        """The held-out error now over that before; None if one of them is missing."""
        return None if not self.was.rms or self.now.rms is None else self.now.rms / self.was.rms

    @property
    def worth_telling(self) -> bool:
        """Whether the versions differ in a result on which a person would act."""
        said = self.was.verdict != self.now.verdict or self.gone or self.new or self.resized
        ratio = self.ratio
        return bool(said) or (ratio is not None and abs(ratio - 1.0) > WORTH)


@dataclass(frozen=True)
class VersionComparison:
    """The data sets that both versions have judged, and those with differences, worst first."""

    since: tuple[str, ...]
    program: str
    compared: int
    missing: int  # judged now, not before
    ratio: float | None  # median of the held-out errors, now over before
    changed: tuple[VersionDifference, ...]


def changes_between(before: Iterable[JobResult], now: Sequence[JobResult], program: str) -> VersionComparison:
    """Compare the results of two versions.

    `before` are results of other versions, oldest first; the newest of each data set counts.
    """
    last = {result.job.data: result for result in before}
    both = [_change(last[each.job.data], each) for each in now if each.job.data in last]
    ratios = [each.ratio for each in both if each.ratio is not None]
    return VersionComparison(
        since=tuple(sorted({last[each.data].job.program for each in both})),
        program=program,
        compared=len(both),
        missing=len(now) - len(both),
        ratio=median(ratios) if ratios else None,
        changed=tuple(
            sorted((each for each in both if each.worth_telling), key=lambda each: -(each.ratio or 1.0))
        ),
    )


def named(version: str, programs: Sequence[str], present: str) -> list[str]:
    """Return the programs that a person means by a version.

    It is the program of this name. Otherwise it is all builds of this release except the present one.

    Raises
    ------
    DataError
        The store has none.
    """
    found = [each for each in programs if each == version]
    found = found or [each for each in programs if release(each) == version and each != present]
    if not found:
        others = sorted(each for each in programs if each != present)
        raise DataError(
            f"'{version}' has no results in this store.",
            do=f"Those it has are of {', '.join(others)}." if others else "It has none but of this version.",
            key="--changed-since",
        )
    return found


def _change(before: JobResult, now: JobResult) -> VersionDifference:
    table = json.loads(now.content)
    return VersionDifference(
        now.job.data, str(table["name"]), _side(json.loads(before.content)), _side(table)
    )


def _side(table: Mapping[str, Any]) -> VersionStatement:
    held_out = table.get("error_after_mm")
    return VersionStatement(
        verdict=table["verdict"],
        effects={e["label"]: (e["value"], e["std"], e["unit"]) for e in table.get("effects", ())},
        rms=None if held_out is None else held_out["rms"],
    )


def _resized(was: tuple[float, float, str], now: tuple[float, float, str]) -> bool:
    if None in (*was, *now):
        return was != now
    return abs(now[0] - was[0]) > max(was[1], now[1])


@cache
def this_program() -> str:
    """Return version and fingerprint, "0.1.0+3f9a1c07b2ee".

    The first is that of `truepose --version`, the second the SHA-256 over the sources of `calib`. It is computed from
    the files on the first call.
    """
    spec = find_spec("calib")
    assert spec is not None
    assert spec.origin is not None
    return f"{metadata.version('truepose')}+{fingerprint(Path(spec.origin).parent)}"


def fingerprint(folder: Path) -> str:
    """Compute the SHA-256 over names and contents of the sources below a folder, shortened.

    Line ends are those of Unix, so that a checkout on Windows is the same program.
    """
    found = hashlib.sha256()
    for file in sorted(each for pattern in _DECIDES for each in folder.rglob(pattern)):
        content = file.read_bytes().replace(b"\r\n", b"\n")
        found.update(f"{file.relative_to(folder).as_posix()} {len(content)}\n".encode())
        found.update(content)
    return found.hexdigest()[:_DIGITS]


def release(of: str) -> str:
    """Return the version of a program without its fingerprint."""
    return of.partition("+")[0]
