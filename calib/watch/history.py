"""The history of a robot's watches: one JSON object a line, appended (`truepose-watch-history/1`).

A line has the residuals whitened by noise, so that the mean over watches needs no old data sets, and the hashes of the
readings, of the baseline and of the poses: only lines of the same baseline and poses belong to one mean. A line that
holds a data set already is never written again.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.saved import SavedModel
from calib.text.files import replace_file
from calib.watch.judge import Verdict
from calib.watch.seen import Seen

FORMAT = "truepose-watch-history/1"
_KEYS = ("data_sha256", "baseline_sha256", "poses_sha256", "verdict", "residual")


@dataclass(frozen=True)
class History:
    """The lines of a history file, oldest first."""

    lines: tuple[dict[str, Any], ...]

    def before(self, seen: Seen, dataset: Dataset, baseline: str) -> tuple[list[Array], int]:
        """Residuals (q,) of earlier watches that belong with this one, up to the last line of this data set where it
        was judged already; and how many lines were left out."""
        marks = (baseline, poses_hash(seen))
        found, left_out = [], 0
        for line in self.lines:
            if line["data_sha256"] == dataset.sha256:
                break
            residual = np.array(line["residual"], dtype=np.float64)
            if (
                line["baseline_sha256"],
                line["poses_sha256"],
            ) == marks and residual.shape == seen.residual.shape:
                found.append(residual)
            else:
                left_out += 1
        return found, left_out

    def holds(self, dataset: Dataset) -> bool:
        """Whether a data set was judged before."""
        return any(line["data_sha256"] == dataset.sha256 for line in self.lines)


def read_history(path: Path) -> History:
    """Read a history; one that does not exist is empty. Raises DataError naming the line."""
    if not path.exists():
        return History(())
    lines = []
    for number, text in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if not text.strip():
            continue
        try:
            line = json.loads(text)
            whole = line["format"] == FORMAT and all(key in line for key in _KEYS)
            whole = whole and bool(np.all(np.isfinite(np.array(line["residual"], dtype=np.float64))))
        except (ValueError, TypeError, KeyError) as error:
            raise _broken(path, number) from error
        if not whole:
            raise _broken(path, number)
        lines.append(line)
    return History(tuple(lines))


def _broken(path: Path, number: int) -> DataError:
    return DataError(
        "is no line of a history of watches.",
        do="Remove the line, or name another file.",
        file=path,
        line=number,
    )


def append(path: Path, seen: Seen, dataset: Dataset, baseline: str, verdict: Verdict) -> None:
    """Append a watch. Raises OSError."""
    occasion = dataset.header.occasion
    line = {
        "format": FORMAT,
        "measured": None if occasion is None else occasion.began,
        "data_sha256": dataset.sha256,
        "baseline_sha256": baseline,
        "poses_sha256": poses_hash(seen),
        "verdict": verdict.kind,
        "causes": [cause.label for cause, _ in verdict.causes],
        "residual": [float(f"{x:.6g}") for x in seen.residual],
    }
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    replace_file(path, text + json.dumps(line, allow_nan=False) + "\n")


def poses_hash(seen: Seen) -> str:
    """SHA-256 of where and how the readings were taken, in their order: joints, sides, targets, what was measured."""
    conditions = seen.readings.conditions
    columns = np.column_stack(
        [
            np.round(np.degrees(conditions.joints), 3),
            conditions.side,
            conditions.target,
            conditions.anchor,
            seen.readings.observed.freedom,
        ]
    )
    names = json.dumps([*conditions.target_names, *conditions.anchor_names])
    return hashlib.sha256(names.encode() + (columns + 0.0).tobytes()).hexdigest()


def baseline_hash(saved: SavedModel) -> str:
    """SHA-256 of what a baseline predicts with: its estimate and the data that it was fitted to."""
    return hashlib.sha256(saved.data_sha256.encode() + saved.estimate.tobytes()).hexdigest()
